// All scripts of the page stand in one function, in the order stage, cloud, layers, frames, arms, tolerances, headline, camera,
// pointer, controls. That of a layer is a function of its settings, layer, and its node of the scene, group.
// Positions are in m, in the axes of the base; matrices are 16 numbers by columns, as three.js keeps them.

const settings = JSON.parse(document.getElementById("settings").textContent);
const element = (id) => document.getElementById(id);
const pane = element("scene-pane");

// on a small screen the settings are folded away
function unfold(open) {
  document.body.dataset.panel = open ? "open" : "folded";
  element("open").setAttribute("aria-expanded", String(open));
  element("open").textContent = open ? "Close" : "Settings";
}
unfold(false);
element("open").addEventListener("click", () => unfold(document.body.dataset.panel !== "open"));

let viewer;
try {
  viewer = new MeshCat.Viewer(pane);
  delete document.body.dataset.still;
} catch (error) {
  element("problem").textContent = "This browser has no WebGL: a still picture stands in place of the 3-D view.";
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
for (const layer of Object.keys(settings.layers)) {
  kinds[layer] = node(layer);
}
// functions of the magnification, for what layers draw too large
const magnified = [];

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
const scheme = window.matchMedia("(prefers-color-scheme: dark)");

function paintGround() {
  viewer.set_property(["Background"], "top_color", scheme.matches ? [0.17, 0.19, 0.23] : [0.94, 0.95, 0.97]);
  viewer.set_property(["Background"], "bottom_color", scheme.matches ? [0.08, 0.09, 0.11] : [0.76, 0.79, 0.83]);
  kinds.grid.traverse((object) => object.material?.color.set(scheme.matches ? 0x39424d : 0x99a3b0));
}
paintGround();

// what shows errors is drawn over the arm: the depths are forgotten before it, and all of it comes in this order
const OVER = { start: 9, errors: 10, marks: 20 };
const curtain = new THREE.Mesh(
  new THREE.BufferGeometry().setFromPoints([0, 1, 2].map(() => new THREE.Vector3())),
  new THREE.MeshBasicMaterial({ transparent: true, colorWrite: false, depthWrite: false, depthTest: false }));
curtain.frustumCulled = false;
curtain.renderOrder = OVER.start;
curtain.onBeforeRender = function (renderer) {
  // what was drawn before may have switched off writing to the depths, and with it their clearing
  renderer.state.buffers.depth.setMask(true);
  renderer.clearDepth();
};
base.add(curtain);

function drawOver(object, order = OVER.errors) {
  object.traverse(function (one) {
    one.renderOrder = order;
    if (one.material) {
      one.material.transparent = true;
    }
  });
}

// light every arm alike, however long it is, and leave white parts their shading
viewer.set_property(["Lights"], "scale", [settings.length, settings.length, settings.length]);
for (const light of ["PointLightNegativeX", "PointLightPositiveX"]) {
  viewer.set_property(["Lights", light, "<object>"], "distance", 0);
  viewer.set_property(["Lights", light, "<object>"], "intensity", 0.33);
}
viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.45);

// the viewer takes the window's height at each of these moments; the pane's comes after it
const fitPane = () => viewer.set_3d_pane_size(pane.clientWidth, pane.clientHeight);
window.addEventListener("load", fitPane);
window.addEventListener("resize", fitPane);
requestAnimationFrame(fitPane);
new ResizeObserver(fitPane).observe(pane);
fitPane();
