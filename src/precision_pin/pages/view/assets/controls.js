// What the reader moves: the factor, the pose, what is seen, and from where.

let factor = settings.factor;
let aboutMean = settings.aboutMean;
let current = 0;
let playing = 0;
let samples = null;
const poses = settings.poses;
const slider = element("factor");
slider.min = Math.log10(settings.smallest);
slider.max = Math.log10(settings.largest);
poses.forEach(unpack);

function three(value) {
  const digits = Math.max(0, 2 - Math.floor(Math.log10(value)));
  return Number(value.toFixed(digits)).toLocaleString("en");
}

// everything that shows errors hangs on this one number
function setFactor(value) {
  factor = Math.min(Math.max(value, settings.smallest), settings.largest);
  errors.scale.set(factor, factor, factor);
  placeErrors();
  showFrames(poses[current], factor);
  showLikenesses(poses[current], factor);
  magnified.forEach((show) => show(factor));
  viewer.set_dirty();
  slider.value = Math.log10(factor);
  slider.setAttribute("aria-valuetext", three(factor) + " times");
  element("factor-text").textContent = element("caption-factor").textContent = three(factor);
  element("example").textContent =
    "1 mm of error is drawn " + (factor < 1000 ? three(factor) + " mm" : three(factor / 1000) + " m") + " long";
  element("true-scale").setAttribute("aria-pressed", String(factor === 1));
  document.body.dataset.factor = factor;
  showRulers();
}

// the tip is where the errors have zero, or their mean
function placeErrors() {
  const tip = new THREE.Vector3(...poses[current].tip.slice(12, 15));
  errors.position.copy(aboutMean ? tip.addScaledVector(new THREE.Vector3(...samples.mean), -factor) : tip);
}

function setMiddle(mean) {
  aboutMean = mean;
  element("about").value = document.body.dataset.about = mean ? "mean" : "zero";
  setFactor(settings.factors[Number(mean)]);
  showMiddle();
  if (!document.body.dataset.camera) {
    look(looking);
  }
}

function showMiddle() {
  element("caption-about").textContent =
    aboutMean ? `from the mean error, which is ${meanSize(samples)} mm` : "from zero error";
  element("from").textContent = aboutMean ? ", from their mean" : "";
}

// the samples, and all that is said and drawn of them
function showSamples() {
  const pose = poses[current];
  samples = samplesOf(pose);
  const matrices = ellipsoidsOf(pose, samples);
  showCloud(samples);
  placeErrors();
  showMiddle();
  showEllipsoids(matrices);
  showLimits(samples);
  showHeadline(pose, samples);
  showMarks(pose, samples);
  showKnobs(pose);
  pick(entered());
  element("drawn").textContent = (samples.positions.length / 3).toLocaleString("en");
  ["inside-inner", "inside-outer"].forEach(function (id, number) {
    element(id).textContent = samples.own
      ? pose.texts[id] : matrices.length > 0 ? `${(100 * insideOf(matrices[number])).toFixed(2)} % of the samples inside` : "none";
  });
  viewer.set_dirty();
}

function insideOf(ellipsoid) {
  const back = ellipsoid.clone().invert();
  const place = new THREE.Vector3();
  const count = samples.positions.length / 3;
  let inside = 0;
  for (let at = 0; at < count; at += 1) {
    inside += place.fromArray(samples.positions, 3 * at).applyMatrix4(back).length() <= 1;
  }
  return inside / count;
}

function setTolerance(group, scale) {
  scales[group] = scale;
  showSamples();
}

function setPose(number) {
  const before = poses[current].tip.slice(12, 15);
  current = Math.min(Math.max(Math.round(number), 0), poses.length - 1);
  const pose = poses[current];
  showArm(pose);
  showMcpc(pose);
  for (const [id, text] of Object.entries(pose.texts)) {
    element(id).textContent = text;
  }
  showSamples();
  showShares(pose, element("shares").checked);
  element("pose").value = current;
  element("pose").setAttribute("aria-valuetext", pose.texts["pose-text"]);
  document.body.dataset.pose = current + 1;
  follow(before, pose.tip.slice(12, 15));
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
  document.body.dataset.boxes = Object.keys(kinds).filter((one) => kinds[one].visible);
  viewer.set_dirty();
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
element("true-scale").addEventListener("click", () => setFactor(factor === 1 ? settings.factors[Number(aboutMean)] : 1));
element("about").addEventListener("change", (event) => setMiddle(event.target.value === "mean"));
knobs.forEach(({ knob }, group) => knob.addEventListener("input", () => setTolerance(group, Number(knob.value))));
element("reset").addEventListener("click", function () {
  scales.fill(1);
  showSamples();
});
element("shares").checked = false;
element("shares").addEventListener("change", (event) => showShares(poses[current], event.target.checked));
scheme.addEventListener("change", function () {
  paintGround();
  paintInk();
  paintBar();
  showSamples();
});
element("see-through").checked = false;
element("see-through").addEventListener("change", (event) => seeThrough(event.target.checked));
// page.html#about=zero&factor=500&look=tip&pose=2&boxes=cloud,arm&camera=1,2,3,0,0,0 opens so
const wanted = new URLSearchParams(location.hash.slice(1));
const boxes = wanted.get("boxes")?.split(",") ?? null;
for (const name of Object.keys(kinds)) {
  const check = element("show-" + name);
  // a browser may bring back the boxes of the last visit
  check.checked = !check.disabled && (boxes ? boxes.includes(name) : check.defaultChecked);
  kinds[name].visible = check.checked;
  check.addEventListener("change", () => show(name, check.checked));
}

const asked = Number(wanted.get("factor"));
seeThrough(false);
aboutMean = wanted.has("about") ? wanted.get("about") === "mean" : aboutMean;
element("about").value = document.body.dataset.about = aboutMean ? "mean" : "zero";
setPose(Number(wanted.get("pose") || 1) - 1 || 0);
setFactor(asked > 0 ? asked : settings.factors[Number(aboutMean)]);
// the grid lies at the foot of the arm, or under a hanging one
viewer.scene.updateMatrixWorld(true);
const lowest = Math.min(0, new THREE.Box3().setFromObject(kinds.arm).min.y);
viewer.set_transform(["meshcat", "grid"], new THREE.Matrix4().makeTranslation(0, 0, lowest).toArray());
look(wanted.get("look") === "tip" ? "tip" : "arm");
const camera = (wanted.get("camera") || "").split(",").map(Number);
if (camera.length === 6 && camera.every(Number.isFinite)) {
  viewer.camera.position.fromArray(camera);
  viewer.controls.target.fromArray(camera, 3);
  viewer.controls.update();
}
// where the reader has gone, for a page that is loaded again
viewer.controls.addEventListener("end", function () {
  document.body.dataset.camera = [...viewer.camera.position.toArray(), ...viewer.controls.target.toArray()];
});
for (const button of ["look-arm", "look-tip"]) {
  element(button).addEventListener("click", () => delete document.body.dataset.camera);
}
showRulers();

// For tests and for the console: what stands in the scene now, to be read only. Matrices go to the axes of the base.
function state() {
  viewer.scene.updateMatrixWorld(true);
  const toBase = base.matrixWorld.clone().invert();
  const stands = (object) => toBase.clone().multiply(object.matrixWorld).toArray();
  return {
    factor, aboutMean, pose: current + 1, playing: playing !== 0,
    seen: Object.fromEntries(Object.entries(kinds).map(([name, group]) => [name, group.visible])),
    cloud: stands(dots), points: Array.from(dots.geometry.attributes.position.array.slice(0, 30)),
    tolerances: scales.slice(), count: samples.positions.length / 3, looking, limits: limits.children.map(stands),
    base: stands(kinds.base), colours: Array.from(dots.geometry.attributes.color.array.slice(0, 30)), mean: stands(meanLine),
    ellipsoids: ellipsoids.map(stands), tip: stands(tipFrame), frames: sampledFrames.children.map(stands),
    mcpc: mcpcFrames.children.map(stands), arm: settings.parts.map(({ name }) => stands(node("arm", name))),
    ghosts: ghosts.map((ghost) => ({ tip: stands(ghost.tip), parts: (ghost.parts || []).map(stands) })),
    deflected: { tip: stands(deflected.tip), parts: (deflected.parts || []).map(stands) },
  };
}
window.precisionPin = Object.freeze({ viewer, state });
document.body.dataset.ready = "yes";
