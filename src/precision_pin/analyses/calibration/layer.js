// A calibration: a rod from the place where each reading is predicted to where it was measured, drawn too large, thin lines for
// the same before the calibration, and a ring with a label about the reading that is marked.

// a picture of one size on the screen, seen through everything
function sprite(width, height, size, draw) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  draw(canvas.getContext("2d"));
  const made = new THREE.Sprite(new THREE.SpriteMaterial({
    map: new THREE.CanvasTexture(canvas), depthTest: false, sizeAttenuation: false }));
  made.scale.set(size * (width / height), size, 1);
  made.renderOrder = OVER.marks + 2;
  return made;
}

function ring(pen) {
  for (const [colour, width] of [["#ffffff", 11], ["#1b222b", 5]]) {
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.beginPath();
    pen.arc(48, 48, 40, 0, 2 * Math.PI);
    pen.stroke();
  }
}

function label(text) {
  return function (pen) {
    pen.fillStyle = "#ffffff";
    pen.strokeStyle = "#1b222b";
    pen.lineWidth = 3;
    pen.fillRect(2, 2, 188, 60);
    pen.strokeRect(2, 2, 188, 60);
    pen.fillStyle = "#1b222b";
    pen.font = "bold 36px sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillText(text, 96, 34, 176);
  };
}

const vectors = (numbers) =>
  [...Array(numbers.length / 3).keys()].map((k) => new THREE.Vector3(...numbers.slice(3 * k, 3 * k + 3)));
const points = vectors(layer.points);
const [after, before] = [vectors(layer.after), vectors(layer.before)];
const radius = 0.003 * settings.length;
const [rodShape, ballShape] = [new THREE.CylinderGeometry(radius, radius, 1, 8), new THREE.SphereGeometry(2.4 * radius, 12, 8)];
const lines = points.map(function (point, k) {
  const material = new THREE.MeshBasicMaterial();
  const [rod, ball] = [rodShape, ballShape].map((shape) => new THREE.Mesh(shape, material));
  group.add(rod, ball);
  return { rod, ball, material };
});
const thin = new THREE.LineSegments(
  new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0x6b7785, transparent: true, opacity: 0.8 }));
const sight = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0x6b7785 }));
thin.frustumCulled = sight.frustumCulled = false;
group.add(thin, sight);
drawOver(group);
const mark = new THREE.Group();
mark.renderOrder = OVER.marks;
group.add(mark);

const paintReadings = function () {
  const palette = stops[theme()];
  lines.forEach(function ({ material }, k) {
    const share = layer.largest > 0 ? Math.min(after[k].length() / layer.largest, 1) : 0;
    material.color.setRGB(...(layer.gross.includes(k) ? OUTSIDE[theme()] : palette[Math.round(share * (palette.length - 1))]));
  });
  node("calibration", "predicted").traverse((one) => one.material?.color.set(INK[theme()]));
  const listed = theme() === "dark" ? settings.darkStops : settings.stops;
  element("calibration-bar").querySelector(".bar").style.background = `linear-gradient(to right, ${listed.join(", ")})`;
};
paintReadings();
scheme.addEventListener("change", paintReadings);

const cut = (move, times) => move.clone().multiplyScalar(times).clampLength(0, layer.longest);
magnified.push(function (value) {
  const times = (layer.times * value) / settings.factor;
  element("calibration-times").textContent = three(times);
  lines.forEach(function ({ rod, ball }, k) {
    const way = cut(after[k], times);
    ball.visible = times * after[k].length() <= layer.longest;
    ball.position.copy(points[k]).add(way);
    rod.visible = way.lengthSq() > 1e-18;
    rod.position.copy(points[k]).addScaledVector(way, 0.5);
    rod.scale.set(1, way.length() || 1, 1);
    rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
  });
  thin.geometry.setFromPoints(points.flatMap((point, k) => [point, point.clone().add(cut(before[k], times))]));
});

const buttons = [...document.querySelectorAll("[data-reading]")];
const markReading = function (k) {
  mark.clear();
  const tag = sprite(192, 64, 0.026, label(`row ${layer.rows[k]}`));
  // on the side where its line is not
  tag.center.set(0.5, after[k].z > 0 ? 2 : -1);
  // at an edge of the picture it moves inwards
  tag.onBeforeRender = function (renderer, scene, camera) {
    const { x } = new THREE.Vector3().setFromMatrixPosition(mark.matrixWorld).project(camera);
    const wide = tag.scale.x * camera.projectionMatrix.elements[0];
    tag.center.x = Math.min(Math.max(0.5, 1 - (1 - x) / wide), (1 + x) / wide);
  };
  mark.add(sprite(96, 96, 0.045, ring), tag);
  mark.position.copy(points[k]);
  mark.userData.row = layer.rows[k];
  sight.geometry.setFromPoints(layer.anchor === null ? [] : [new THREE.Vector3(...layer.anchor), points[k]]);
  buttons.forEach((button) => button.setAttribute("aria-pressed", String(Number(button.dataset.reading) === k)));
  viewer.set_dirty();
};
buttons.forEach((button) => button.addEventListener("click", () => markReading(Number(button.dataset.reading))));
markReading(0);
const earlier = element("calibration-before");
thin.visible = earlier.checked = earlier.defaultChecked;
earlier.addEventListener("change", function () {
  thin.visible = earlier.checked;
  viewer.set_dirty();
});
