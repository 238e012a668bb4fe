// What the reader moves: the factor, the pose, what is seen, and from where.

let factor = settings.factor;
let current = 0;
let playing = 0;
const poses = settings.poses;
const slider = element("factor");
slider.min = Math.log10(settings.smallest);
slider.max = Math.log10(settings.largest);
// targets and displacements as numbers, once
for (const pose of poses) {
  pose.targets = floats(pose.targets);
  pose.deflected = floats(pose.deflected);
  pose.ghosts = pose.ghosts.map(floats);
}

function three(value) {
  const digits = Math.max(0, 2 - Math.floor(Math.log10(value)));
  return Number(value.toFixed(digits)).toLocaleString("en");
}

// everything that shows errors hangs on this one number
function setFactor(value) {
  factor = Math.min(Math.max(value, settings.smallest), settings.largest);
  errors.scale.set(factor, factor, factor);
  showFrames(poses[current], factor);
  showLikenesses(poses[current], factor);
  viewer.set_dirty();
  slider.value = Math.log10(factor);
  slider.setAttribute("aria-valuetext", three(factor) + " times");
  element("factor-text").textContent = element("caption-factor").textContent = three(factor);
  element("example").textContent =
    "1 mm of error is drawn " + (factor < 1000 ? three(factor) + " mm" : three(factor / 1000) + " m") + " long";
  document.body.dataset.factor = factor;
}

function setPose(number) {
  current = Math.min(Math.max(Math.round(number), 0), poses.length - 1);
  const pose = poses[current];
  showArm(pose);
  showMcpc(pose);
  showCloud(pose);
  showEllipsoids(pose);
  errors.position.set(...pose.tip.slice(12, 15));
  for (const [id, text] of Object.entries(pose.texts)) {
    element(id).textContent = text;
  }
  element("pose").value = current;
  element("pose").setAttribute("aria-valuetext", pose.texts["pose-text"]);
  document.body.dataset.pose = current + 1;
  setFactor(factor);
}

function play(on) {
  clearInterval(playing);
  playing = on ? setInterval(() => setPose((current + 1) % poses.length), Math.min(1000, 8000 / poses.length)) : 0;
  element("play").textContent = on ? "Pause" : "Play";
}

function show(name, seen) {
  kinds[name].visible = seen;
  showLikenesses(poses[current], factor);
  viewer.set_dirty();
}

function lookAt(box) {
  const sphere = box.getBoundingSphere(new THREE.Sphere());
  const radius = Math.max(sphere.radius, settings.frame);
  const camera = viewer.camera;
  const half = Math.min(1, camera.aspect || 1) * Math.tan(camera.fov * Math.PI / 360);
  const distance = radius / Math.sin(Math.atan(half));
  // the scene's z points up, the camera's y
  const direction = new THREE.Vector3(settings.from[0], settings.from[2], -settings.from[1]).normalize();
  camera.near = distance / 1000;
  camera.far = distance * 100;
  camera.position.copy(sphere.center).addScaledVector(direction, distance);
  viewer.controls.target.copy(sphere.center);
  viewer.controls.update();
  viewer.set_dirty();
}

function look(what) {
  viewer.scene.updateMatrixWorld(true);
  const box = new THREE.Box3().setFromObject(errors).union(new THREE.Box3().setFromObject(kinds.tip));
  if (what === "arm") {
    box.union(new THREE.Box3().setFromObject(kinds.arm));
    for (const stands of poses.flatMap((pose) => [...pose.links, pose.tip])) {
      box.expandByPoint(new THREE.Vector3(...stands.slice(12, 15)).applyMatrix4(base.matrixWorld));
    }
  }
  lookAt(box);
  document.body.dataset.look = what;
}

slider.addEventListener("input", () => setFactor(10 ** Number(slider.value)));
element("pose").max = poses.length - 1;
element("poses").hidden = poses.length < 2;
element("pose").addEventListener("input", function (event) {
  play(false);
  setPose(Number(event.target.value));
});
element("play").addEventListener("click", () => play(!playing));
element("look-arm").addEventListener("click", () => look("arm"));
element("look-tip").addEventListener("click", () => look("tip"));
element("see-through").addEventListener("change", (event) => seeThrough(event.target.checked));
for (const name of Object.keys(kinds)) {
  const box = element("show-" + name);
  // a browser may bring back the boxes of the last visit
  kinds[name].visible = box.checked = box.defaultChecked;
  box.addEventListener("change", () => show(name, box.checked));
}

// page.html#factor=500&look=tip&pose=2 opens so
const wanted = new URLSearchParams(location.hash.slice(1));
const asked = Number(wanted.get("factor"));
setPose(Number(wanted.get("pose") || 1) - 1 || 0);
setFactor(asked > 0 ? asked : settings.factor);
// the grid lies at the foot of the arm, or under a hanging one
viewer.scene.updateMatrixWorld(true);
const lowest = Math.min(0, new THREE.Box3().setFromObject(kinds.arm).min.y);
viewer.set_transform(["meshcat", "grid"], new THREE.Matrix4().makeTranslation(0, 0, lowest).toArray());
look(wanted.get("look") === "tip" ? "tip" : "arm");

// For tests and for the console: what stands in the scene now, to be read only. Matrices go to the axes of the base.
function state() {
  viewer.scene.updateMatrixWorld(true);
  const toBase = base.matrixWorld.clone().invert();
  const stands = (object) => toBase.clone().multiply(object.matrixWorld).toArray();
  return {
    factor, pose: current + 1, playing: playing !== 0,
    seen: Object.fromEntries(Object.entries(kinds).map(([name, group]) => [name, group.visible])),
    cloud: stands(dots), points: Array.from(dots.geometry.attributes.position.array.slice(0, 30)),
    colours: Array.from(dots.geometry.attributes.color.array.slice(0, 30)), mean: stands(meanLine),
    ellipsoids: ellipsoids.map(stands), tip: stands(tipFrame), frames: sampledFrames.children.map(stands),
    mcpc: mcpcFrames.children.map(stands), arm: settings.parts.map(({ name }) => stands(node("arm", name))),
    ghosts: ghosts.map((ghost) => ({ tip: stands(ghost.tip), parts: (ghost.parts || []).map(stands) })),
    deflected: { tip: stands(deflected.tip), parts: (deflected.parts || []).map(stands) },
  };
}
window.precisionPin = Object.freeze({ viewer, state });
document.body.dataset.ready = "yes";
