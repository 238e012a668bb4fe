// What becomes of the samples when tolerances are changed, to first order: see tolerances.py, which packs the numbers.

const scales = settings.tolerances.map(() => 1);
const rows = settings.deviations.map((text) => new Int16Array(bytes(text).buffer));
const isChanged = () => scales.some((scale) => scale !== 1);

// numbers of a pose as arrays, and what the first order leaves of each sample
function unpack(pose) {
  pose.points = floats(pose.points);
  pose.turns = floats(pose.turns);
  pose.targets = floats(pose.targets);
  pose.deflected = floats(pose.deflected);
  pose.ghosts = pose.ghosts.map(floats);
  pose.ellipsoids = pose.ellipsoids.map((numbers) => matrix(numbers));
  const { live } = pose;
  if (live !== null) {
    live.deviations = live.deviations.map((row) => rows[row]);
    live.total = varianceOf(live, scales.map(() => 1));
  }
}

// of the position, every tolerance so many times as wide
function varianceOf({ variances }, factors) {
  return factors.reduce((sum, one, g) => sum + factors.reduce((part, other, h) => part + one * other * variances[g][h], 0), 0);
}

// what a group of tolerances does to a sample, [d; δ]
function partOf(live, group, at) {
  const part = [0, 0, 0, 0, 0, 0];
  live.group.forEach(function (owner, row) {
    if (owner === group) {
      const steps = scales[group] * live.deviations[row][at];
      live.slopes[row].forEach((slope, axis) => { part[axis] += steps * slope; });
    }
  });
  return part;
}

// e + Σ (k_g − 1) c_g + (s − 1) r, r = e − e₀ − Σ c_g: three numbers a sample of those from `from` on
function changed(live, given, from) {
  const share = live.total > 0 ? varianceOf(live, scales) / live.total : 1;
  const result = new Float32Array(3 * live.count);
  for (let axis = 0; axis < 3; axis += 1) {
    const now = live.slopes.map((slopes, row) => slopes[from + axis] * scales[live.group[row]]);
    const before = live.slopes.map((slopes) => slopes[from + axis]);
    for (let at = 0; at < live.count; at += 1) {
      let sum = live.centre[from + axis];
      let left = given[3 * at + axis] - sum;
      for (let row = 0; row < now.length; row += 1) {
        const steps = live.deviations[row][at];
        sum += now[row] * steps;
        left -= before[row] * steps;
      }
      result[3 * at + axis] = sum + share * left;
    }
  }
  return result;
}

function meanOf(positions) {
  const sums = [0, 0, 0];
  positions.forEach((value, at) => { sums[at % 3] += value; });
  return sums.map((sum) => (3 * sum) / positions.length);
}

// the samples as the sliders have them; the sheet's own are all there, others as many as there is room for
function samplesOf(pose) {
  const { live } = pose;
  if (live === null || !isChanged()) {
    return { positions: pose.points, turns: pose.turns, mean: pose.mean.slice(0, 3), own: true };
  }
  const positions = changed(live, pose.points, 0);
  const turns = pose.turns.length > 0 ? changed(live, pose.turns, 3) : pose.turns;
  return { positions, turns, mean: meanOf(positions), own: false };
}

// ellipsoids of the samples' mean and covariance: any root of the covariance takes the ball there, here Cholesky's in the
// directions of the sheet's own ellipsoid
function ellipsoidsOf(pose, sample) {
  if (sample.own || pose.ellipsoids.length === 0) {
    return pose.ellipsoids;
  }
  const turn = new THREE.Matrix4().extractRotation(pose.ellipsoids[0]);
  const axes = [0, 1, 2].map((column) => turn.elements.slice(4 * column, 4 * column + 3));
  const count = sample.positions.length / 3;
  const covariance = [0, 1, 2].map(() => [0, 0, 0]);
  for (let at = 0; at < count; at += 1) {
    const away = axes.map((axis) => axis.reduce((sum, part, k) => sum + part * (sample.positions[3 * at + k] - sample.mean[k]), 0));
    away.forEach((one, i) => away.forEach((other, j) => { covariance[i][j] += (one * other) / (count - 1); }));
  }
  const widest = Math.max(...covariance.map((row, k) => row[k]));
  if (!(widest > 0)) {
    return [];
  }
  const root = [0, 1, 2].map(() => [0, 0, 0]);
  let freedom = 0;
  for (let i = 0; i < 3; i += 1) {
    for (let j = 0; j <= i; j += 1) {
      const rest = covariance[i][j] - root[i].slice(0, j).reduce((sum, part, k) => sum + part * root[j][k], 0);
      if (i === j) {
        // flat to a hundred-thousandth, which is where the packed numbers end
        freedom += rest > 1e-10 * widest;
        root[i][i] = Math.sqrt(Math.max(rest, 1e-8 * widest));
      } else {
        root[i][j] = rest / root[j][j];
      }
    }
  }
  return pose.live.reach[freedom - 1].map(function (reach) {
    const cells = [0, 1, 2].map((column) => [0, 1, 2].map((k) =>
      reach * axes.reduce((sum, axis, i) => sum + axis[k] * root[i][column], 0)));
    return matrix([...cells[0], 0, ...cells[1], 0, ...cells[2], 0, ...sample.mean, 1]);
  });
}

// the sliders -------------------------------------------------------------------------------------------------------------

const knobs = settings.tolerances.map(function (name, group) {
  const line = document.createElement("li");
  const label = document.createElement("label");
  const words = document.createElement("span");
  const value = document.createElement("output");
  const knob = document.createElement("input");
  words.textContent = name;
  label.htmlFor = knob.id = "tolerance" + group;
  Object.assign(knob, { type: "range", min: 0, max: 3, step: 0.05, value: 1 });
  label.append(words, value);
  line.append(label, knob);
  element("sliders").append(line);
  return { knob, value };
});
element("tolerances").hidden = knobs.length === 0 || settings.poses.every(({ live }) => live === null);

function showKnobs(pose) {
  const total = pose.live === null ? 0 : varianceOf(pose.live, scales);
  knobs.forEach(function ({ knob, value }, group) {
    const part = total > 0
      ? scales[group] * scales.reduce((sum, one, other) => sum + one * pose.live.variances[group][other], 0) / total : 0;
    value.textContent = `×${scales[group].toFixed(2)}, ${(100 * part).toFixed(part < 0.0995 ? 1 : 0)} %`;
    knob.value = scales[group];
    knob.setAttribute("aria-valuetext", `${scales[group].toFixed(2)} times the sheet's tolerance`);
  });
  const few = pose.live !== null && 3 * pose.live.count < pose.points.length;
  element("live-count").textContent = few ? ` The first ${pose.live.count.toLocaleString("en")} robots follow.` : "";
}
