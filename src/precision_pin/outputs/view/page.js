"use strict";
(function () {
  const settings = JSON.parse(document.getElementById("settings").textContent);
  const problem = document.getElementById("problem");
  const pane = document.getElementById("pane");
  let viewer;
  try {
    viewer = new MeshCat.Viewer(pane);
  } catch (error) {
    problem.textContent = "The 3-D view cannot be drawn: this browser has no WebGL.";
    problem.hidden = false;
    return;
  }
  for (const command of JSON.parse(document.getElementById("scene").textContent)) {
    viewer.handle_command_bytearray(Uint8Array.from(atob(command), (character) => character.charCodeAt(0)));
  }
  const THREE = MeshCat.THREE;
  const node = (...path) => viewer.scene_tree.find(["meshcat", ...path]).object;

  viewer.set_property(["Background"], "top_color", [0.94, 0.95, 0.97]);
  viewer.set_property(["Background"], "bottom_color", [0.76, 0.79, 0.83]);
  // light every arm alike, however long it is, and leave white parts their shading
  viewer.set_property(["Lights"], "scale", [settings.length, settings.length, settings.length]);
  for (const light of ["PointLightNegativeX", "PointLightPositiveX"]) {
    viewer.set_property(["Lights", light, "<object>"], "distance", 0);
    viewer.set_property(["Lights", light, "<object>"], "intensity", 0.33);
  }
  viewer.set_property(["Lights", "AmbientLight", "<object>"], "intensity", 0.45);
  const dots = node("cloud", "<object>").material;
  dots.sizeAttenuation = false;
  dots.size = 2.5;

  // everything that shows errors hangs on this one number
  let factor = settings.factor;
  const slider = document.getElementById("factor");
  slider.min = Math.log10(settings.smallest);
  slider.max = Math.log10(settings.largest);

  function three(value) {
    const digits = Math.max(0, 2 - Math.floor(Math.log10(value)));
    return Number(value.toFixed(digits)).toLocaleString("en");
  }

  function setFactor(value) {
    factor = Math.min(Math.max(value, settings.smallest), settings.largest);
    viewer.set_property(["meshcat", "cloud"], "scale", [factor, factor, factor]);
    settings.frames.forEach(function (error, number) {
      const turn = new THREE.Vector3(error[3], error[4], error[5]);
      const angle = Math.min(factor * turn.length(), Math.PI / 2);
      const pose = new THREE.Matrix4().makeRotationAxis(turn.normalize(), angle);
      pose.multiply(new THREE.Matrix4().fromArray(settings.rotation));
      pose.setPosition(
        settings.tip[0] + factor * error[0], settings.tip[1] + factor * error[1], settings.tip[2] + factor * error[2]);
      viewer.set_transform(["meshcat", "frames", "frame" + number], pose.toArray());
    });
    viewer.set_dirty();
    slider.value = Math.log10(factor);
    slider.setAttribute("aria-valuetext", three(factor) + " times");
    document.getElementById("factor-text").textContent = three(factor);
    document.getElementById("example").textContent =
      "1 mm of error is drawn " + (factor < 1000 ? three(factor) + " mm" : three(factor / 1000) + " m") + " long";
    document.body.dataset.factor = factor;
    document.body.dataset.cloudScale = node("cloud").scale.x;
  }

  function lookAt(box, closest) {
    const sphere = box.getBoundingSphere(new THREE.Sphere());
    const radius = Math.max(sphere.radius, closest);
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

  function errorsBox() {
    viewer.scene.updateMatrixWorld(true);
    return new THREE.Box3().setFromObject(node("cloud")).union(new THREE.Box3().setFromObject(node("tip")));
  }

  function look(what) {
    const box = errorsBox();
    lookAt(what === "tip" ? box : box.union(new THREE.Box3().setFromObject(node("arm"))), settings.closest);
    document.body.dataset.look = what;
  }

  function seeThrough(clear) {
    node("arm").traverse(function (object) {
      if (object.material) {
        object.material.solid = object.material.solid || object.material.opacity;
        object.material.opacity = object.material.solid * (clear ? 0.25 : 1);
        object.material.transparent = object.material.opacity < 1;
        object.material.depthWrite = !clear;
        object.material.needsUpdate = true;
      }
    });
    viewer.set_dirty();
  }

  // the grid lies at the foot of the arm, or under a hanging one
  viewer.scene.updateMatrixWorld(true);
  const lowest = Math.min(0, new THREE.Box3().setFromObject(node("arm")).min.y);
  viewer.set_transform(["meshcat", "grid"], new THREE.Matrix4().makeTranslation(0, 0, lowest).toArray());

  // the viewer takes the window's height at each of these moments; the pane's comes after it
  const fit = () => viewer.set_3d_pane_size(pane.clientWidth, pane.clientHeight);
  window.addEventListener("load", fit);
  window.addEventListener("resize", fit);
  requestAnimationFrame(fit);

  viewer.camera.fov = 40;
  slider.addEventListener("input", () => setFactor(10 ** Number(slider.value)));
  document.getElementById("look-arm").addEventListener("click", () => look("arm"));
  document.getElementById("look-tip").addEventListener("click", () => look("tip"));
  document.getElementById("see-through").addEventListener("change", (event) => seeThrough(event.target.checked));
  document.getElementById("show-frames").addEventListener("change", function (event) {
    viewer.set_property(["meshcat", "frames"], "visible", event.target.checked);
    viewer.set_dirty();
  });

  // page.html#factor=500&look=tip opens so
  const wanted = new URLSearchParams(location.hash.slice(1));
  const asked = Number(wanted.get("factor"));
  fit();
  setFactor(asked > 0 ? asked : settings.factor);
  look(wanted.get("look") === "tip" ? "tip" : "arm");
  window.precisionPin = { viewer, setFactor, look };
  document.body.dataset.ready = "yes";
})();
