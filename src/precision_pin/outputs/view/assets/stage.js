// All scripts of the page stand in one function, in the order stage, cloud, frames, arms, controls.
// Positions are in m, in the axes of the base; matrices are 16 numbers by columns, as three.js keeps them.

const settings = JSON.parse(document.getElementById("settings").textContent);
const element = (id) => document.getElementById(id);
const pane = element("pane");
let viewer;
try {
  viewer = new MeshCat.Viewer(pane);
} catch (error) {
  element("problem").textContent = "The 3-D view cannot be drawn: this browser has no WebGL.";
  element("problem").hidden = false;
  return;
}
for (const command of JSON.parse(element("scene").textContent)) {
  viewer.handle_command_bytearray(bytes(command));
}
const THREE = MeshCat.THREE;
const node = (...path) => viewer.scene_tree.find(["meshcat", ...path]).object;

// the base; what shows errors is put here, beside the arm and the grid of the scene
const base = node();
const kinds = { arm: node("arm"), grid: node("grid") };

function kind(name, parent = base) {
  kinds[name] = new THREE.Group();
  parent.add(kinds[name]);
  return kinds[name];
}

function bytes(text) {
  return Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
}

const floats = (text) => new Float32Array(bytes(text).buffer);
const matrix = (numbers, start = 0) => new THREE.Matrix4().fromArray(numbers, start);

function put(object, pose) {
  object.matrixAutoUpdate = false;
  object.matrix.copy(pose);
  object.matrixWorldNeedsUpdate = true;
}

// Trans(k d) Exp(k δ); it turns by 90° at most, beyond which a picture says nothing
function displacement(numbers, start, factor) {
  const [dx, dy, dz, rx, ry, rz] = numbers.slice(start, start + 6);
  const turn = new THREE.Vector3(rx, ry, rz);
  const angle = Math.min(factor * turn.length(), Math.PI / 2);
  return new THREE.Matrix4().makeRotationAxis(turn.normalize(), angle).setPosition(factor * dx, factor * dy, factor * dz);
}

viewer.camera.fov = 40;
viewer.set_property(["Background"], "top_color", [0.94, 0.95, 0.97]);
viewer.set_property(["Background"], "bottom_color", [0.76, 0.79, 0.83]);
// light every arm alike, however long it is, and leave white parts their shading
viewer.set_property(["Lights"], "scale", [settings.length, settings.length, settings.length]);
for (const light of ["PointLightNegativeX", "PointLightPositiveX"]) {
  viewer.set_property(["Lights", light, "<object>"], "distance", 0);
  viewer.set_property(["Lights", light, "<object>"], "intensity", 0.33);
}
viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.45);

// the viewer takes the window's height at each of these moments; the pane's comes after it
const fit = () => viewer.set_3d_pane_size(pane.clientWidth, pane.clientHeight);
window.addEventListener("load", fit);
window.addEventListener("resize", fit);
requestAnimationFrame(fit);
fit();
