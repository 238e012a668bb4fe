// The cloud, its mean and its ellipsoids, about the nominal tip and at the errors' true size: one scale enlarges all.

const errors = new THREE.Group();
base.add(errors);

const stops = settings.stops.map((stop) => [1, 3, 5].map((at) => parseInt(stop.slice(at, at + 2), 16) / 255));
const dots = new THREE.Points(
  new THREE.BufferGeometry(), new THREE.PointsMaterial({ size: 2.5, sizeAttenuation: false, vertexColors: true }));
kind("cloud", errors).add(dots);

const meanLine = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: 0x1a1a1a }));
kind("mean", errors).add(meanLine);

// the colour of an error's size, as on the bar
function paint(size, colours, start) {
  const span = settings.colours[1] - settings.colours[0];
  const share = span > 0 ? Math.min(Math.max((size - settings.colours[0]) / span, 0), 1) : 0;
  const place = share * (stops.length - 1);
  const first = Math.min(Math.floor(place), stops.length - 2);
  for (let part = 0; part < 3; part += 1) {
    colours[start + part] = stops[first][part] + (place - first) * (stops[first + 1][part] - stops[first][part]);
  }
}

function showCloud(pose) {
  const positions = floats(pose.points);
  const colours = new Float32Array(positions.length);
  for (let at = 0; at < positions.length; at += 3) {
    paint(Math.hypot(positions[at], positions[at + 1], positions[at + 2]), colours, at);
  }
  dots.geometry.dispose();
  dots.geometry = new THREE.BufferGeometry();
  dots.geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
  dots.geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
  meanLine.geometry.dispose();
  meanLine.geometry = new THREE.BufferGeometry().setFromPoints([new THREE.Vector3(), new THREE.Vector3(...pose.mean)]);
}

// a unit ball with three circles on it
function ball(name, colour, opacity) {
  const whole = new THREE.Group();
  const skin = new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity, depthWrite: false });
  whole.add(new THREE.Mesh(new THREE.SphereGeometry(1, 48, 32), skin));
  const circle = [...Array(97).keys()].map((step) => (step * Math.PI) / 48)
    .map((angle) => new THREE.Vector3(Math.cos(angle), Math.sin(angle), 0));
  for (const turn of [[0, 0], [Math.PI / 2, 0], [0, Math.PI / 2]]) {
    const line = new THREE.Line(
      new THREE.BufferGeometry().setFromPoints(circle), new THREE.LineBasicMaterial({ color: colour }));
    line.rotation.set(turn[0], turn[1], 0);
    whole.add(line);
  }
  kind(name, errors).add(whole);
  return whole;
}

const ellipsoids = [ball("inner", 0xe69f00, 0.12), ball("outer", 0x56b4e9, 0.1)];

function showEllipsoids(pose) {
  ellipsoids.forEach(function (ellipsoid, number) {
    ellipsoid.visible = pose.ellipsoids.length > 0;
    if (ellipsoid.visible) {
      put(ellipsoid, matrix(pose.ellipsoids[number]));
    }
  });
}
