// The answer at the top: as computed with the sheet's tolerances, or anew for the samples as the sliders have them.

function quantileOf(ordered, level) {
  const place = level * (ordered.length - 1);
  const below = Math.floor(place);
  const above = Math.min(below + 1, ordered.length - 1);
  return ordered[below] + (place - below) * (ordered[above] - ordered[below]);
}

// P(B ≤ k), B binomial (n, p)
function binomial(k, n, p, logs) {
  let sum = 0;
  for (let j = 0; j <= k; j += 1) {
    sum += Math.exp(logs[n] - logs[j] - logs[n - j] + j * Math.log(p) + (n - j) * Math.log1p(-p));
  }
  return sum;
}

// the Clopper-Pearson interval of a probability
function intervalOf(inside, count) {
  const logs = new Float64Array(count + 1);
  for (let j = 2; j <= count; j += 1) {
    logs[j] = logs[j - 1] + Math.log(j);
  }
  const tail = (1 - settings.confidence) / 2;
  // where a falling function of p crosses a value
  const solve = function (k, level) {
    let [low, high] = [0, 1];
    for (let step = 0; step < 50; step += 1) {
      const middle = (low + high) / 2;
      [low, high] = binomial(k, count, middle, logs) > level ? [middle, high] : [low, middle];
    }
    return (low + high) / 2;
  };
  return [inside > 0 ? solve(inside - 1, 1 - tail) : 0, inside < count ? solve(inside, tail) : 1];
}

const fixed = (value, place, round = Math.round) => {
  const step = 10 ** place;
  return (round(value / step) * step + 0).toFixed(Math.max(0, -place));
};

// the last digit is the first uncertain one, and what is printed lies inside the interval
function supported(value, low, high) {
  const half = Math.max(value - low, high - value);
  let place = half > 1e-9 * value ? Math.ceil(Math.log10(half / 5)) : Math.floor(Math.log10(value || 1)) - 4;
  while (place > -12 && !(low <= Number(fixed(value, place)) && Number(fixed(value, place)) <= high) && high > low) {
    place -= 1;
  }
  return fixed(value, place);
}

function outward(low, high) {
  const place = high > low ? Math.floor(Math.log10(high - low)) - 1 : Math.floor(Math.log10(high || 1)) - 4;
  return [fixed(low, place, Math.floor), fixed(high, place, Math.ceil)];
}

function sizeLine(sample, live) {
  const count = sample.positions.length / 3;
  const sizes = Float64Array.from({ length: count }, (_, at) => quantityOf(0, sample, at)).sort();
  const [unit, per] = sizes[count - 1] < 1e-4 ? ["µm", 1e6] : ["mm", 1e3];
  const all = poses[current].points.length / 3;
  const robots = count === all
    ? `${count.toLocaleString("en")} robots` : `${count.toLocaleString("en")} of ${all.toLocaleString("en")} robots, which follow the sliders`;
  if (sizes[count - 1] - sizes[0] <= 1e-12) {
    return [`Every robot within ${(per * sizes[count - 1]).toPrecision(4)} ${unit}`, `${robots}, all alike`, ""];
  }
  if (live.ranks[1] === null) {
    return [`${robots} are too few for the 95 % quantile`, "add samples", ""];
  }
  const ends = live.ranks[1].map((rank) => per * sizes[rank - 1]);
  const [low, high] = outward(...ends);
  return [
    `95 % of robots within ${supported(per * quantileOf(sizes, 0.95), ...ends)} ${unit}`,
    `interval ${low} to ${high} ${unit} at ${100 * settings.confidence} % confidence; ${robots}`, ""];
}

// distances from the mean error
function fromMean({ positions, mean }) {
  return Float64Array.from({ length: positions.length / 3 }, (_, at) =>
    Math.hypot(...mean.map((value, axis) => positions[3 * at + axis] - value))).sort();
}

const rootMeanSquare = (sizes) => Math.sqrt(sizes.reduce((sum, size) => sum + size * size, 0) / sizes.length);

// the size of the mean error in mm
function meanSize(sample) {
  const size = 1e3 * Math.hypot(...sample.mean);
  const half = (2e3 * rootMeanSquare(fromMean(sample))) / Math.sqrt(sample.positions.length / 3);
  return half > 1e-9 * size ? supported(size, size - half, size + half) : String(Number(size.toPrecision(3)));
}

// a mean error that is far larger than the spread about it
function constantLines(sample, live) {
  const sizes = fromMean(sample);
  const spread = rootMeanSquare(sizes);
  if (!(spread > 1e-12 && Math.hypot(...sample.mean) > settings.far * spread) || live.ranks[1] === null) {
    return [];
  }
  const within = supported(1e3 * quantileOf(sizes, 0.95), ...live.ranks[1].map((rank) => 1e3 * sizes[rank - 1]));
  return [[`Mean error ${meanSize(sample)} mm, the same for every robot`, `95 % of robots within ${within} mm of it`, ""]];
}

function limitLine(asked, sample, [why, taken]) {
  const { required, text } = asked;
  if (why) {
    return [`Not judged: ${text}`, why, "not judged"];
  }
  const count = sample.positions.length / 3;
  const values = Array.from({ length: count }, (_, at) => shareOf(asked, sample, at));
  const inside = values.filter((value) => value <= 1).length;
  const [low, high] = intervalOf(inside, count);
  const varies = asked.parts.some(function (part) {
    const along = values.map((_, at) => alongOf(part, sample, at));
    return part.axes.some((_, k) =>
      Math.max(...along.map((row) => row[k])) - Math.min(...along.map((row) => row[k])) > 1e-12);
  });
  const verdict = high < required ? "not met" : !varies ? "nothing to judge" : low >= required ? "met" : "undecided";
  const demanded = String(Number((100 * required).toPrecision(10))).split(".")[1] || "";
  const place = -Math.max(1 - Math.floor(Math.log10(100 * (high - low))), demanded.length, 0);
  // the changed sheet was not sampled: its robots are the sheet's, moved to first order
  return [
    `To first order ${verdict}${verdict === "met" ? taken : ""}: ${text}`,
    `${fixed((100 * inside) / count, place)} % inside, interval ${fixed(100 * low, place, Math.floor)} to ` +
      `${fixed(100 * high, place, Math.ceil)} %; analyze with --set judges it`, "estimate"];
}

function showHeadline(pose, sample) {
  const lines = sample.own
    ? pose.answers : [...settings.limits.map((one) => limitLine(one, sample, pose.grounds)), sizeLine(sample, pose.live),
      ...constantLines(sample, pose.live)];
  element("headline").replaceChildren(...lines.flatMap(function ([text, detail, verdict]) {
    const answer = document.createElement("p");
    const fine = document.createElement("p");
    answer.className = "answer";
    answer.dataset.verdict = verdict;
    answer.textContent = text;
    fine.className = "fine";
    fine.textContent = detail;
    return [answer, fine];
  }));
  element("changed").hidden = sample.own;
}

const percent = (share) => `${Number((100 * share).toPrecision(6))} %`;

// quantiles on the colour bar
function showMarks(pose, sample) {
  const count = sample.positions.length / 3;
  const sizes = Float64Array.from({ length: count }, (_, at) => quantityOf(0, sample, at)).sort();
  const found = sample.own ? pose.marks : settings.levels.map(function (level, at) {
    const ranks = pose.live.ranks[at];
    return ranks === null ? null : [quantileOf(sizes, level), sizes[ranks[0] - 1], sizes[ranks[1] - 1]];
  });
  const [smallest, largest] = settings.colours;
  const per = largest < 1e-4 ? 1e6 : 1e3;
  const known = settings.levels.map((level, at) => [level, found[at]]).filter(([, mark]) => mark !== null);
  element("bar").replaceChildren(...known.map(function ([level, [value]]) {
    const mark = document.createElement("i");
    const share = largest > smallest ? (value - smallest) / (largest - smallest) : 0;
    mark.style.left = `${100 * Math.min(Math.max(share, 0), 1)}%`;
    mark.title = percent(level);
    return mark;
  }));
  const texts = known.map(([level, mark]) => `${percent(level)}: ${supported(...mark.map((value) => per * value))}`);
  element("marks").textContent = texts.length === 0 ? "" : `Marks: so many robots stay below; ${texts.join(", ")}`;
}

function paintBar() {
  const colours = scheme.matches ? settings.darkStops : settings.stops;
  element("bar").style.background = `linear-gradient(to right, ${colours.join(", ")})`;
}
paintBar();
