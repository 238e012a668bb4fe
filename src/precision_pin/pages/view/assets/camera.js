// Where the reader looks from, and how large things are there.

let looking = "arm";

// the scene's z points up, the camera's y
const toScene = ([x, y, z]) => new THREE.Vector3(x, z, -y);

// the nearest camera in a direction that sees all points, three.js's axes
function lookAt(points, direction) {
  const { camera, controls } = viewer;
  const toward = toScene(direction).normalize();
  const right = new THREE.Vector3(0, 1, 0).cross(toward).normalize();
  const up = toward.clone().cross(right);
  const high = 0.9 * Math.tan((camera.fov * Math.PI) / 360);
  const wide = high * (camera.aspect || 1);
  // the rulers are at the bottom
  const low = Math.min(high, (high / 0.9) * Math.max(0.6, 1 - 120 / (pane.clientHeight || 600)));
  const sides = [-Infinity, -Infinity, -Infinity, -Infinity];
  const depths = [Infinity, -Infinity];
  for (const point of points) {
    const [x, y, z] = [right, up, toward].map((axis) => axis.dot(point));
    [x + wide * z, -x + wide * z, y + high * z, -y + low * z].forEach((side, at) => { sides[at] = Math.max(sides[at], side); });
    depths[0] = Math.min(depths[0], z);
    depths[1] = Math.max(depths[1], z);
  }
  const nearest = depths[1] + 3 * settings.frame;
  const away = Math.max((sides[0] + sides[1]) / (2 * wide), (sides[2] + sides[3]) / (high + low), nearest);
  const middle = right.clone().multiplyScalar((sides[0] - sides[1]) / 2).addScaledVector(up, (sides[2] - sides[3] + (low - high) * away) / 2);
  const depth = (depths[0] + depths[1]) / 2;
  camera.near = (away - depth) / 1000;
  camera.far = (away - depth) * 100;
  camera.zoom = 1;
  camera.position.copy(middle).addScaledVector(toward, away);
  controls.target.copy(middle).addScaledVector(toward, depth);
  controls.update();
  viewer.set_dirty();
}

function cornersOf(object) {
  const corners = [];
  object.traverse(function (one) {
    if (one.isMesh && one.geometry.attributes.position.count > 0) {
      one.geometry.computeBoundingBox();
      const { min, max } = one.geometry.boundingBox;
      for (const x of [min.x, max.x]) {
        for (const y of [min.y, max.y]) {
          for (const z of [min.z, max.z]) {
            corners.push(new THREE.Vector3(x, y, z).applyMatrix4(one.matrixWorld));
          }
        }
      }
    }
  });
  return corners;
}

function cloudCorners() {
  const { position } = dots.geometry.attributes;
  const points = [new THREE.Vector3(...(aboutMean ? samples.mean : [0, 0, 0])), ...Array.from(
    { length: position.count }, (_, at) => new THREE.Vector3().fromBufferAttribute(position, at))];
  return points.map((point) => point.applyMatrix4(errors.matrixWorld));
}

// a box about the errors of a pose as they are drawn
function boxCorners(pose) {
  pose.box ??= new THREE.Box3().setFromArray(pose.points);
  const middle = aboutMean ? pose.mean.slice(0, 3) : [0, 0, 0];
  const tip = pose.tip.slice(12, 15);
  return [...Array(8).keys()].map((corner) => new THREE.Vector3(...["x", "y", "z"].map((axis, k) =>
    tip[k] + factor * ((corner >> k) & 1 ? pose.box.max : pose.box.min)[axis] - factor * middle[k])).applyMatrix4(base.matrixWorld));
}

// the side of the tip where the arm is not: of many directions from above, the one that the arm is farthest from
function freeSide(pose) {
  const tip = new THREE.Vector3(...pose.tip.slice(12, 15));
  const joints = [...pose.links.map((link) => new THREE.Vector3(...link.slice(12, 15))), tip];
  const arm = [];
  joints.slice(1).forEach(function (end, at) {
    for (let step = 0; step < 12; step += 1) {
      const away = joints[at].clone().lerp(end, step / 12).sub(tip);
      if (away.length() > 0.02 * settings.length) {
        arm.push(away.normalize());
      }
    }
  });
  const usual = new THREE.Vector3(...settings.from).normalize();
  const long = pose.ellipsoids.length > 0 ? new THREE.Vector3().setFromMatrixColumn(pose.ellipsoids[0], 0).normalize() : usual;
  let best = { cost: Infinity, side: usual };
  for (const height of [0.15, 0.35, 0.6]) {
    for (let turn = 0; turn < 36; turn += 1) {
      const angle = (turn * Math.PI) / 18;
      const side = new THREE.Vector3(Math.cos(angle), Math.sin(angle), height).normalize();
      const hidden = Math.max(-1, ...arm.map((one) => one.dot(side)));
      const along = Math.abs(long.dot(side));
      const cost = 2 * Math.max(hidden - 0.3, 0) - 0.4 * side.dot(usual) + (long === usual ? 0 : 0.4 * along);
      best = cost < best.cost ? { cost, side } : best;
    }
  }
  return best.side.toArray();
}

function look(what) {
  looking = what;
  viewer.scene.updateMatrixWorld(true);
  const points = [...cloudCorners(), ...cornersOf(kinds.tip)];
  const pose = poses[current];
  if (what === "arm") {
    points.push(...cornersOf(kinds.arm), ...(kinds.base.visible ? cornersOf(kinds.base) : []),
      ...Object.keys(settings.layers).flatMap((layer) => (kinds[layer].visible ? cornersOf(kinds[layer]) : [])));
    for (const stands of poses.flatMap((one) => [...one.links, one.tip])) {
      points.push(new THREE.Vector3(...stands.slice(12, 15)).applyMatrix4(base.matrixWorld));
    }
    points.push(...poses.filter((one) => one !== pose).flatMap(boxCorners));
    lookAt(points, settings.from);
  } else {
    lookAt(points, freeSide(pose));
  }
  document.body.dataset.look = what;
}

function isInWindow(place) {
  viewer.camera.updateMatrixWorld();
  const { x, y, z } = toScene(place).project(viewer.camera);
  return Math.max(Math.abs(x), Math.abs(y)) < 0.9 && z < 1;
}

// the camera goes with the end effector if it looks at it, or if the end effector would leave the window
function follow(before, after) {
  if (looking === "tip" || !isInWindow(after)) {
    const way = toScene(after).sub(toScene(before));
    viewer.camera.position.add(way);
    viewer.controls.target.add(way);
    viewer.controls.update();
  }
}

// the length of a ruler: 1, 2 or 5 times a power of ten
function round125(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [5, 2, 1].find((digit) => digit * power <= value * (1 + 1e-9));
}

function withUnit(metres) {
  const [unit, per] = metres >= 1 ? ["m", 1] : metres >= 1e-3 ? ["mm", 1e3] : metres >= 1e-6 ? ["µm", 1e6] : ["nm", 1e9];
  return `${Number((per * metres).toPrecision(3))} ${unit}`;
}

// two rulers, of errors and of the arm, true at the distance of the end effector
function showRulers() {
  const { camera } = viewer;
  camera.updateMatrixWorld();
  const tip = new THREE.Vector3(...poses[current].tip.slice(12, 15)).applyMatrix4(base.matrixWorld);
  const depth = -tip.applyMatrix4(camera.matrixWorldInverse).z;
  const pixels = (pane.clientHeight * camera.zoom) / (2 * Math.tan((camera.fov * Math.PI) / 360) * depth);
  element("rulers").hidden = !(depth > 0 && pixels > 0);
  if (!element("rulers").hidden) {
    const [error, arm] = [round125(120 / (pixels * factor)), round125(120 / pixels)];
    element("error-ruler").style.width = `${error * factor * pixels}px`;
    element("arm-ruler").style.width = `${arm * pixels}px`;
    element("error-length").textContent = `${withUnit(error)} of error`;
    element("arm-scale").textContent = `${withUnit(arm)} of the arm`;
  }
}
viewer.controls.addEventListener("change", () => showRulers());
// the picture fits the pane until the reader moves the camera
new ResizeObserver(function () {
  if (document.body.dataset.ready && !document.body.dataset.camera) {
    fitPane();
    look(looking);
  }
  showRulers();
}).observe(pane);
