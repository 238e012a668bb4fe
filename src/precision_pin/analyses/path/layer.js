// A path: a tube about its line whose radius is the error at each point, drawn too large, and a cone at the worst point.

const RING = 16;

// around each point a ring across the way, each turned as little as possible against the one before
function ringsOf(points) {
  const count = points.length;
  const tangent = (k) => {
    const along = points[Math.min(k + 1, count - 1)].clone().sub(points[Math.max(k - 1, 0)]);
    return along.lengthSq() > 0 ? along.normalize() : new THREE.Vector3(0, 0, 1);
  };
  const rings = [];
  let side = null;
  for (let k = 0; k < count; k += 1) {
    const along = tangent(k);
    const from = side ?? (Math.abs(along.z) < 0.9 ? new THREE.Vector3(0, 0, 1) : new THREE.Vector3(1, 0, 0));
    const across = from.clone().addScaledVector(along, -from.dot(along));
    side = across.lengthSq() > 1e-12 ? across.normalize() : new THREE.Vector3(-along.z, along.x, along.y).cross(along).normalize();
    const third = along.clone().cross(side);
    rings.push([...Array(RING).keys()].map(function (step) {
      const angle = (2 * Math.PI * step) / RING;
      return side.clone().multiplyScalar(Math.cos(angle)).addScaledVector(third, Math.sin(angle));
    }));
  }
  return rings;
}

function tube(group, count, material) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * RING * count), 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(3 * RING * count), 3));
  const faces = [];
  for (let k = 0; k + 1 < count; k += 1) {
    for (let step = 0; step < RING; step += 1) {
      const [a, b] = [k * RING + step, k * RING + ((step + 1) % RING)];
      faces.push(a, b, a + RING, b, b + RING, a + RING);
    }
  }
  geometry.setIndex(faces);
  const mesh = new THREE.Mesh(geometry, material);
  mesh.frustumCulled = false;
  group.add(mesh);
  return mesh;
}

const points = [...Array(layer.band.length).keys()].map((k) => new THREE.Vector3(...layer.points.slice(3 * k, 3 * k + 3)));
const rings = ringsOf(points);
const inner = tube(group, points.length, new THREE.MeshBasicMaterial({ vertexColors: true, side: THREE.DoubleSide }));
const outer = tube(group, points.length, skin(0x6b7785, 0.22));
outer.material.side = THREE.DoubleSide;
const cone = new THREE.Mesh(
  new THREE.ConeGeometry(0.012 * settings.length, 0.04 * settings.length, 24), new THREE.MeshBasicMaterial({ color: INK.light }));
group.add(cone);
const palette = shades(settings.stops);
const span = layer.colours[1] - layer.colours[0];
layer.quantile.forEach(function (size, k) {
  const place = (span > 0 ? (size - layer.colours[0]) / span : 1) * (palette.length - 1);
  const colour = palette[Math.round(Math.min(Math.max(place, 0), palette.length - 1))];
  for (let step = 0; step < RING; step += 1) {
    inner.geometry.attributes.color.array.set(colour, 3 * (k * RING + step));
  }
});
// the slider widens the tubes in proportion
magnified.push(function (value) {
  const times = (layer.times * value) / settings.factor;
  element("path-times").textContent = three(times);
  for (const [mesh, radii] of [[inner, layer.quantile], [outer, layer.band]]) {
    const places = mesh.geometry.attributes.position;
    rings.forEach((ring, k) => ring.forEach((out, step) =>
      places.array.set(points[k].clone().addScaledVector(out, times * radii[k]).toArray(), 3 * (k * RING + step))));
    places.needsUpdate = true;
  }
  // its point touches the outer tube from above
  cone.rotation.set(-Math.PI / 2, 0, 0);
  cone.position.copy(points[layer.worst]);
  cone.position.z += times * layer.band[layer.worst] + 0.02 * settings.length;
});
