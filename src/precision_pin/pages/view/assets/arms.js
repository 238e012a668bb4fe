// The arm, and its likenesses with errors: as sampled units are built, and with every draw at its mean.
//
// A likeness is the chain multiplied out: the targets' displacements E_k, enlarged, in their undisplaced frames T_k move
// whatever lies beyond them, M = Π T_k E_k T_k⁻¹. The geometry is the arm's own.

function showArm(pose) {
  for (const { name, link, frame } of settings.parts) {
    put(node("arm", name), matrix(pose.links[link]).multiply(matrix(frame)));
  }
}

class Likeness {
  constructor(parent, colour) {
    this.material = new THREE.MeshPhongMaterial({
      color: colour, transparent: true, opacity: 0.45, flatShading: true, shininess: 10,
      // where a likeness stands on the arm, the arm is seen
      polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8 });
    this.parts = null;
    this.tip = new THREE.Group();
    this.whole = new THREE.Group();
    this.whole.add(this.tip);
    parent.add(this.whole);
  }

  // made when first seen: most readers never look
  make() {
    this.parts = settings.parts.map(({ name }) => node("arm", name).clone(true));
    for (const part of this.parts) {
      part.traverse((object) => { object.material = object.isMesh ? this.material : object.material; });
      this.whole.add(part);
    }
  }

  show(pose, displacements, factor) {
    if (this.parts === null) {
      this.make();
    }
    const motions = [new THREE.Matrix4()];
    for (let at = 0; 6 * at < displacements.length; at += 1) {
      const frame = matrix(pose.targets, 16 * at);
      const moved = frame.clone().multiply(displacement(displacements, 6 * at, factor)).multiply(frame.invert());
      motions.push(motions[at].clone().multiply(moved));
    }
    settings.parts.forEach(({ link, frame }, number) => {
      const stands = matrix(pose.links[link]).multiply(matrix(frame));
      put(this.parts[number], motions[pose.before[number]].clone().multiply(stands));
    });
    put(this.tip, motions[motions.length - 1].multiply(matrix(pose.tip)));
  }
}

const ghosts = settings.poses[0].ghosts.map(() => new Likeness(kinds.ghosts || kind("ghosts"), 0x7f8fe0));
const deflected = new Likeness(kind("deflected"), 0xe07fb0);

function showLikenesses(pose, factor) {
  // drawn from the mean error, from the arm with every draw at its mean
  const from = (displacements) => displacements.map((value, k) => value - (aboutMean ? pose.deflected[k] : 0));
  if (kinds.ghosts && kinds.ghosts.visible) {
    ghosts.forEach((ghost, number) => ghost.show(pose, from(pose.ghosts[number]), factor));
  }
  if (kinds.deflected.visible) {
    deflected.show(pose, from(pose.deflected), factor);
  }
}

// the arm: how clear it is, and its colours -----------------------------------------------------------------------------

const LAST = Math.max(...settings.parts.map(({ link }) => link));
const PALE = new THREE.Color(0xeceff2);
const STRONG = new THREE.Color(0xd55e00);

function eachMaterial(change) {
  settings.parts.forEach(function ({ name, link }) {
    node("arm", name).traverse(function (object) {
      if (object.material) {
        change(object.material, link);
        object.material.needsUpdate = true;
      }
    });
  });
  viewer.set_dirty();
}

// the last link stands where the errors are: it is always faint
function seeThrough(clear) {
  eachMaterial(function (material, link) {
    material.userData.solid = material.userData.solid || material.opacity;
    material.opacity = material.userData.solid * (clear ? 0.25 : link === LAST ? 0.45 : 1);
    material.transparent = material.opacity < 1;
    material.depthWrite = !material.transparent;
  });
}

function showShares(pose, on) {
  const largest = Math.max(...pose.shares, 1e-12);
  eachMaterial(function (material, link) {
    material.userData.own = material.userData.own || material.color.clone();
    const share = Math.max(pose.shares[link], 0) / largest;
    material.color.copy(on ? PALE.clone().lerp(STRONG, share) : material.userData.own);
  });
  element("share-scale").textContent = on ? `: 0 to ${(100 * largest).toFixed(0)} %` : "";
}
