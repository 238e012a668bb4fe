// What the reader points at: a sample, or a joint.

const REACH = 12;
const signed = (metres) => (1e3 * metres).toPrecision(3);

function robotText(number) {
  const { positions } = samples;
  const [x, y, z] = [0, 1, 2].map((axis) => positions[3 * number + axis]);
  const lines = [
    `Robot ${number.toLocaleString("en")} of seed ${settings.seed}: |d| ${signed(Math.hypot(x, y, z))} mm`,
    `(${signed(x)}, ${signed(y)}, ${signed(z)}) mm` + (isOutside(samples, number) ? ", outside the limit" : "")];
  const { live } = poses[current];
  if (live !== null && number < live.count) {
    const parts = settings.tolerances.map((_, group) => Math.hypot(...partOf(live, group, number).slice(0, 3)));
    const largest = parts.indexOf(Math.max(...parts));
    lines.push(`Largest part beyond the mean: ${settings.tolerances[largest]}, ${signed(parts[largest])} mm`);
  }
  return lines.join("\n");
}

function jointText(joint) {
  const share = poses[current].shares[joint + 1];
  return `Joint ${settings.joints[joint]}` +
    `\nwith the link that it moves: ${(100 * share).toFixed(1)} % of the variance of the position`;
}

function pick(number) {
  const known = number !== null && 3 * number < samples.positions.length;
  picked.visible = known;
  if (known) {
    picked.position.fromArray(samples.positions, 3 * number);
  }
  element("robot-text").textContent = known
    ? robotText(number) : "Point at a sample in the picture, or enter its number.";
  viewer.set_dirty();
}

const entered = () => (element("robot").value === "" ? null : Math.max(0, Math.round(Number(element("robot").value))));
element("robot").addEventListener("input", () => pick(entered()));

// the nearest of many places in the picture, of those within reach
function nearest(places, count, toPicture, x, y) {
  let found = null;
  let least = REACH;
  const seen = new THREE.Vector3();
  for (let at = 0; at < count; at += 1) {
    places(at, seen).applyMatrix4(toPicture);
    const away = Math.hypot((0.5 + seen.x / 2) * pane.clientWidth - x, (0.5 - seen.y / 2) * pane.clientHeight - y);
    if (away < least && seen.z < 1) {
      [found, least] = [at, away];
    }
  }
  return found;
}

function pointAt(x, y) {
  viewer.scene.updateMatrixWorld(true);
  const { camera } = viewer;
  camera.updateMatrixWorld();
  const view = camera.projectionMatrix.clone().multiply(camera.matrixWorldInverse);
  const { links } = poses[current];
  const sample = kinds.cloud.visible ? nearest(
    (at, place) => place.fromArray(samples.positions, 3 * at), samples.positions.length / 3,
    view.clone().multiply(errors.matrixWorld), x, y) : null;
  const joint = sample === null ? nearest(
    (at, place) => place.fromArray(links[at + 1], 12), settings.joints.length,
    view.clone().multiply(base.matrixWorld), x, y) : null;
  const hover = element("hover");
  hover.hidden = sample === null && joint === null;
  if (sample !== null) {
    element("robot").value = sample;
    pick(sample);
  }
  if (!hover.hidden) {
    hover.textContent = sample !== null ? robotText(sample) : jointText(joint);
    hover.style.left = `${Math.max(4, Math.min(x + 14, pane.clientWidth - hover.offsetWidth - 4))}px`;
    hover.style.top = `${Math.max(4, Math.min(y + 14, pane.clientHeight - hover.offsetHeight - 4))}px`;
  }
}

let awaited = false;
function pointed(event) {
  if (event.buttons > 0 && event.type === "pointermove") {
    element("hover").hidden = true;
    return;
  }
  if (!awaited) {
    awaited = true;
    const frame = pane.getBoundingClientRect();
    requestAnimationFrame(function () {
      awaited = false;
      pointAt(event.clientX - frame.left, event.clientY - frame.top);
    });
  }
}
pane.addEventListener("pointermove", pointed);
pane.addEventListener("pointerup", pointed);
pane.addEventListener("pointerleave", () => { element("hover").hidden = true; });
