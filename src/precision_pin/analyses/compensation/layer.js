// A compensation: at its worst pose the arm as a line through its joints, commanded, deflected and corrected, and the ways of
// the tip; every point stands aside from the arm without error by its displacement, drawn too large.

const LINE_STEPS = 8;

const lines = layer.lines.map(function ({ colour, radius, points, moves }) {
  const ends = [...Array(points.length / 3).keys()].map((k) => [
    new THREE.Vector3(...points.slice(3 * k, 3 * k + 3)), new THREE.Vector3(...moves.slice(3 * k, 3 * k + 3))]);
  const material = new THREE.MeshBasicMaterial({ color: colour });
  if (radius === 0) {
    const thin = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ color: colour }));
    thin.frustumCulled = false;
    group.add(thin);
    return { ends, thin, rods: [], balls: [] };
  }
  // a rod between each two points, a ball at each
  const rods = ends.slice(1).map(() => new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, 1, LINE_STEPS), material));
  const balls = ends.map(() => new THREE.Mesh(new THREE.SphereGeometry(1.6 * radius, 12, 8), material));
  group.add(...rods, ...balls);
  return { ends, rods, balls };
});
magnified.push(function (value) {
  const times = (layer.times * value) / settings.factor;
  element("compensation-times").textContent = three(times);
  for (const { ends, thin, rods, balls } of lines) {
    const places = ends.map(([point, move]) => point.clone().addScaledVector(move, times));
    thin?.geometry.setFromPoints(places);
    balls.forEach((ball, k) => ball.position.copy(places[k]));
    rods.forEach(function (rod, k) {
      const way = places[k + 1].clone().sub(places[k]);
      rod.visible = way.lengthSq() > 1e-18;
      rod.position.copy(places[k]).addScaledVector(way, 0.5);
      rod.scale.set(1, way.length() || 1, 1);
      rod.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
    });
  }
});
