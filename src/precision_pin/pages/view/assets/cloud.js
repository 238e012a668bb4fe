// The cloud, its mean, its ellipsoids and the limits, about zero error and at the errors' true size: one scale
// enlarges all, and one place puts zero error or the mean at the nominal tip.

const errors = new THREE.Group();
base.add(errors);

const shades = (texts) => texts.map((text) => [1, 3, 5].map((at) => parseInt(text.slice(at, at + 2), 16) / 255));
const stops = { light: shades(settings.stops), dark: shades(settings.darkStops) };
const OUTSIDE = { light: [0xd1, 0x33, 0x0a].map((part) => part / 255), dark: [1, 0x5a / 255, 0x36 / 255] };
const INK = { light: 0x1a1a1a, dark: 0xe4e9ef };
const theme = () => (scheme.matches ? "dark" : "light");

const dots = new THREE.Points(
  new THREE.BufferGeometry(), new THREE.PointsMaterial({ size: 2.5, sizeAttenuation: false, vertexColors: true }));
kind("cloud", errors).add(dots);
const meanLine = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: INK.light }));
kind("mean", errors).add(meanLine);
// the sample that the reader points at
const picked = new THREE.Points(
  new THREE.BufferGeometry().setFromPoints([new THREE.Vector3()]),
  new THREE.PointsMaterial({ size: 10, sizeAttenuation: false, color: INK.light, depthTest: false }));
picked.visible = false;
errors.add(picked);

// the colour of an error's size, as on the bar
function paint(size, colours, start, outside) {
  if (outside) {
    colours.set(OUTSIDE[theme()], start);
    return;
  }
  const scale = stops[theme()];
  const span = settings.colours[1] - settings.colours[0];
  const share = span > 0 ? Math.min(Math.max((size - settings.colours[0]) / span, 0), 1) : 0;
  const place = share * (scale.length - 1);
  const first = Math.min(Math.floor(place), scale.length - 2);
  for (let part = 0; part < 3; part += 1) {
    colours[start + part] = scale[first][part] + (place - first) * (scale[first + 1][part] - scale[first][part]);
  }
}

// the value of one of the eight quantities, 0 to 3 of the position and 4 to 7 of the attitude, the norm first
function quantityOf(row, sample, at) {
  const numbers = row < 4 ? sample.positions : sample.turns;
  return row % 4 === 0
    ? Math.hypot(numbers[3 * at], numbers[3 * at + 1], numbers[3 * at + 2]) : numbers[3 * at + (row % 4) - 1];
}

// the components of a sample's error that a part of a limit is about, along base axes or the tool's
function alongOf({ first, axes, in_tool: inTool }, sample, at) {
  const numbers = (first === 0 ? sample.positions : sample.turns).subarray(3 * at, 3 * at + 3);
  const { tip } = poses[current];
  return axes.map((axis) =>
    inTool ? numbers.reduce((sum, value, k) => sum + tip[4 * axis + k] * value, 0) : numbers[axis]);
}

// the largest of a sample's errors over their limits; the angle by which the tool's z tilts is exact
function shareOf({ parts }, sample, at) {
  return Math.max(...parts.map(function (part) {
    const length = Math.hypot(...alongOf(part, sample, at));
    const half = part.is_tilt ? quantityOf(4, sample, at) / 2 : 0;
    const tilt = half > 0 ? 2 * Math.asin(Math.min((length * Math.sin(half)) / (2 * half), 1)) : length;
    return (part.factor * tilt) / part.limit;
  }));
}

const isOutside = (sample, at) => settings.limits.some((one) => shareOf(one, sample, at) > 1);

function showCloud(sample) {
  const { positions } = sample;
  const colours = new Float32Array(positions.length);
  let outside = 0;
  for (let at = 0; 3 * at < positions.length; at += 1) {
    const out = isOutside(sample, at);
    outside += out;
    paint(quantityOf(0, sample, at), colours, 3 * at, out);
  }
  dots.geometry.dispose();
  dots.geometry = new THREE.BufferGeometry();
  dots.geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  dots.geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  element("outside").textContent =
    settings.limits.length > 0 ? `, ${outside.toLocaleString("en")} of them outside` : "";
  meanLine.geometry.dispose();
  meanLine.geometry = new THREE.BufferGeometry().setFromPoints([new THREE.Vector3(), new THREE.Vector3(...sample.mean)]);
}

function paintInk() {
  meanLine.material.color.set(INK[theme()]);
  picked.material.color.set(INK[theme()]);
}
paintInk();

function skin(colour, opacity) {
  return new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity, depthWrite: false });
}

// a unit ball with three circles on it
function ball(group, colour, opacity) {
  const whole = new THREE.Group();
  whole.add(new THREE.Mesh(new THREE.SphereGeometry(1, 48, 32), skin(colour, opacity)));
  const circle = [...Array(97).keys()].map((step) => (step * Math.PI) / 48)
    .map((angle) => new THREE.Vector3(Math.cos(angle), Math.sin(angle), 0));
  for (const turn of [[0, 0], [Math.PI / 2, 0], [0, Math.PI / 2]]) {
    const line = new THREE.Line(
      new THREE.BufferGeometry().setFromPoints(circle), new THREE.LineBasicMaterial({ color: colour }));
    line.rotation.set(turn[0], turn[1], 0);
    whole.add(line);
  }
  group.add(whole);
  return whole;
}

const ellipsoids = [ball(kind("inner", errors), 0xe69f00, 0.12), ball(kind("outer", errors), 0x56b4e9, 0.1)];

function showEllipsoids(matrices) {
  ellipsoids.forEach(function (ellipsoid, number) {
    ellipsoid.visible = matrices.length > 0;
    if (ellipsoid.visible) {
      put(ellipsoid, matrices[number]);
    }
  });
}

// limits of the position: a ball, or a box, which is open where an axis has no limit
const limits = kind("limit", errors);
for (const { row, limit } of settings.limits) {
  if (row === 0) {
    ball(limits, 0xd1330a, 0.06).scale.setScalar(limit);
  }
}
const walls = [1, 2, 3].map((row) =>
  Math.min(Infinity, ...settings.limits.filter((one) => one.row === row).map((one) => one.limit)));
let box = null;
if (walls.some(Number.isFinite)) {
  box = new THREE.Group();
  const cube = new THREE.BoxGeometry(2, 2, 2);
  box.add(new THREE.Mesh(cube, skin(0xd1330a, 0.06)));
  box.add(new THREE.LineSegments(new THREE.EdgesGeometry(cube), new THREE.LineBasicMaterial({ color: 0xd1330a })));
  limits.add(box);
}

// across an axis without a limit the box is a little larger than the cloud
function showLimits({ positions }) {
  if (box !== null) {
    const reach = [1e-9, 1e-9, 1e-9];
    positions.forEach((value, at) => { reach[at % 3] = Math.max(reach[at % 3], 1.2 * Math.abs(value)); });
    box.scale.set(...walls.map((wall, axis) => (Number.isFinite(wall) ? wall : reach[axis])));
  }
}
drawOver(errors);
drawOver(picked, OVER.marks);
