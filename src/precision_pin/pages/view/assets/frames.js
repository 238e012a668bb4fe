// Frames: of the end effector without error and of sampled units, and those of the MCPC model.

// Okabe and Ito (2008): vermilion, bluish green, blue stay apart for colour-blind readers
const AXIS_COLOURS = [0xd55e00, 0x009e73, 0x0072b2];

function axes(length, thickness, through = false) {
  const frame = new THREE.Group();
  AXIS_COLOURS.forEach(function (color, number) {
    const material = new THREE.MeshPhongMaterial({ color, depthTest: !through, transparent: through });
    const rod = new THREE.Mesh(new THREE.CylinderGeometry(thickness, thickness, length, 12), material);
    // three.js lays a cylinder along y
    rod.rotation.set(number === 2 ? Math.PI / 2 : 0, 0, number === 0 ? -Math.PI / 2 : 0);
    rod.position.setComponent(number, length / 2);
    rod.renderOrder = through ? OVER.marks : 0;
    frame.add(rod);
  });
  return frame;
}

const tipFrame = axes(settings.frame, 0.035 * settings.frame);
kind("tip").add(tipFrame);
drawOver(tipFrame);
kind("base").add(axes(2 * settings.frame, 0.05 * settings.frame));

const sampledFrames = kind("frames");
for (let count = 0; count < settings.poses[0].frames.length; count += 1) {
  sampledFrames.add(axes(0.7 * settings.frame, 0.0126 * settings.frame));
}
drawOver(sampledFrames);

function showFrames(pose, factor) {
  const tip = matrix(pose.tip);
  put(tipFrame, tip);
  sampledFrames.children.forEach(function (frame, number) {
    const moved = displacement(pose.frames[number].map((value, k) => value - (aboutMean ? pose.mean[k] : 0)), 0, factor);
    const shift = new THREE.Vector3().setFromMatrixPosition(moved).add(new THREE.Vector3().setFromMatrixPosition(tip));
    put(frame, moved.multiply(tip).setPosition(shift));
  });
}

// the number of a frame, of one size on the screen, seen through the arm
function numbered(number) {
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = 64;
  const pen = canvas.getContext("2d");
  pen.fillStyle = "#ffffff";
  pen.strokeStyle = "#1b222b";
  pen.lineWidth = 3;
  pen.beginPath();
  pen.arc(32, 32, 29, 0, 2 * Math.PI);
  pen.fill();
  pen.stroke();
  pen.fillStyle = "#1b222b";
  pen.font = "bold 36px sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.fillText(String(number), 32, 34);
  const label = new THREE.Sprite(new THREE.SpriteMaterial({
    map: new THREE.CanvasTexture(canvas), depthTest: false, sizeAttenuation: false }));
  label.scale.set(0.024, 0.024, 1);
  label.renderOrder = OVER.marks + 1;
  return label;
}

const mcpcFrames = kind("mcpc");
settings.mcpc.forEach(function (entry, number) {
  const frame = axes(0.9 * settings.frame, 0.02 * settings.frame, true);
  frame.add(numbered(number));
  mcpcFrames.add(frame);
});

function showMcpc(pose) {
  const taken = [];
  mcpcFrames.children.forEach(function (frame, number) {
    const { link, frame: local } = settings.mcpc[number];
    const stands = matrix(pose.links[link]).multiply(matrix(local));
    put(frame, stands);
    // numbers of frames at one place stand side by side
    const origin = new THREE.Vector3().setFromMatrixPosition(stands);
    const before = taken.filter((other) => other.distanceTo(origin) < 0.06 * settings.length).length;
    taken.push(origin);
    frame.children[3].center.set(0.5 - 1.1 * before, -0.3);
  });
}
