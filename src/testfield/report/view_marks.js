// Markers, ellipsoids and errors of targets, marks of boards, and what a chosen station or target lights up.
const STOPS = ["#482576", "#414487", "#35608d", "#2a788e", "#21918c", "#22a884", "#43bf71", "#7ad151", "#bddf26", "#fde725"].map((c) => new THREE.Color(c));
const isDark = () => document.documentElement.dataset.theme === "dark";
// Its darkest part cannot be seen on dark ground.
const viridis = (part) => {
  const least = isDark() ? 0.22 : 0, at = (least + (1 - least) * Math.min(1, Math.max(0, part))) * (STOPS.length - 1), k = Math.min(STOPS.length - 2, Math.floor(at));
  return STOPS[k].clone().lerp(STOPS[k + 1], at - k);
};
const KIND = { board: "#8a94a0", bar: "#e08a1e", check: "#2f8fd0" };
const NONE = "#9a9a9a", LIT = new THREE.Color("#ff4d3a");

// A marker has the same size on the screen from everywhere, and a rim by which neighbours are told apart.
function marker(square) {
  const [map, context] = texture(32, 32);
  const shape = (size) => { context.beginPath(); square ? context.rect(16 - size, 16 - size, 2 * size, 2 * size) : context.arc(16, 16, size, 0, 2 * Math.PI); context.fill(); };
  context.fillStyle = "#444";
  shape(15);
  context.fillStyle = "#fff";
  shape(11);
  return map;
}
function markers(positions, size, square) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(positions), 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(positions.length).fill(1), 3));
  const material = new THREE.PointsMaterial({ size, sizeAttenuation: false, vertexColors: true, map: marker(square), alphaTest: 0.4 });
  const made = new THREE.Points(geometry, material);
  scene.add(made);
  return made;
}
const places = (marks) => Array.from(marks).flatMap((k) => [num.mark_mm[3 * k], num.mark_mm[3 * k + 1], num.mark_mm[3 * k + 2]]);
const targets = markers(places(num.target), count.targets > 1500 ? 5 : 9, false);
const dots = markers(places(onBoards), 5, false);
const cameras = markers(num.eye_mm, count.stations > 40 ? 8 : 11, true);
groups.dots = [dots];
groups.cameras = [cameras];

// What a mode shows of a mark: a value on a scale, or a kind.
const u = Float64Array.from({ length: count.targets }, (_, k) => uncertainty(num.axes_mm, k).all);
const size = about.run ? Float64Array.from({ length: count.targets }, (_, k) => Math.hypot(...errorOf(k))) : null;
const ofTarget = (values) => (mark) => isTarget[mark] >= 0 ? values[isTarget[mark]] : NaN;
const MODES = {
  kind: { title: "kind", kinds: KIND, of: (mark) => about.roles[num.mark_role[mark]] },
  rays: { title: "number of rays", of: (mark) => num.rays[mark], whole: true },
  angle: { title: "convergence angle", unit: "°", of: (mark) => num.rays[mark] > 1 ? num.angle_deg[mark] : NaN, none: "in fewer than two images" },
  u: { title: "predicted standard uncertainty", unit: "mm", of: ofTarget(u), log: true, down: true, none: "not predicted" },
};
if (about.run) {
  MODES.error = { title: "actual error", unit: "mm", of: ofTarget(size), log: true, down: true, none: "not measured" };
  MODES.ratio = { title: "actual error over predicted uncertainty", unit: "", of: ofTarget(size.map((e, k) => e / u[k])), down: true, none: "not measured" };
}
const state = { mode: "kind", station: -1, mark: -1, whose: "axes_mm", enlarge: 12, base: 1 };

function scaleOf(mode) {
  // `reduce`, because a call takes no hundred thousand arguments.
  const shown = (isTarget.some((k) => k >= 0) ? Array.from(num.target) : onBoards).map(mode.of).filter(Number.isFinite);
  if (!shown.length) return null;
  let first = shown.reduce((a, b) => Math.min(a, b)), last = shown.reduce((a, b) => Math.max(a, b));
  if (mode.log) first = Math.max(first, last * 1e-3, 1e-9);
  if (!(last > first)) last = first + (mode.whole ? 1 : Math.max(1e-9, 0.05 * Math.abs(first)));
  const part = (v) => mode.log ? Math.log(Math.max(v, 1e-12) / first) / Math.log(last / first) : (v - first) / (last - first);
  return { first, last, colour: (v) => viridis(mode.down ? 1 - part(v) : part(v)) };
}
let scale = null;
function colourOf(mark) {
  const mode = MODES[state.mode], value = mode.of(mark);
  if (mode.kinds) return new THREE.Color(mode.kinds[value]);
  return scale && Number.isFinite(value) ? scale.colour(value) : new THREE.Color(NONE);
}
// What the chosen station does not see is faint.
let lit = null, faint = new THREE.Color();
const shown = (mark) => mark === state.mark ? LIT : lit && !lit.has(mark) ? faint : colourOf(mark);
function paint() {
  scale = MODES[state.mode].kinds ? null : scaleOf(MODES[state.mode]);
  lit = state.station >= 0 ? new Set(seenBy(state.station)) : null;
  faint.set(isDark() ? "#3a444b" : "#dcdcdc");
  const dark = isDark();
  for (const [points, marks] of [[targets, num.target], [dots, onBoards]]) {
    const colours = points.geometry.attributes.color;
    Array.from(marks).forEach((mark, k) => {
      const colour = lit && lit.has(mark) && points === dots ? LIT : shown(mark);
      colours.setXYZ(k, colour.r, colour.g, colour.b);
    });
    colours.needsUpdate = true;
  }
  const saw = state.mark >= 0 ? new Set(seeing(state.mark)) : null, own = cameras.geometry.attributes.color;
  for (let s = 0; s < count.stations; s++) {
    const colour = s === state.station || (saw && saw.has(s)) ? LIT : new THREE.Color(dark ? "#c6d2da" : "#33424e");
    own.setXYZ(s, colour.r, colour.g, colour.b);
  }
  own.needsUpdate = true;
  ellipsoids();
}

// Ellipsoids: bodies of the nearest targets, axes as lines of all where there are more.
const BODIES = 1200;
const bodies = new THREE.InstancedMesh(new THREE.IcosahedronGeometry(1, count.targets > 200 ? 1 : 3), new THREE.MeshLambertMaterial({ transparent: true, opacity: about.run ? 0.55 : 0.8 }), Math.max(1, Math.min(BODIES, count.targets)));
bodies.frustumCulled = false;
const crosses = lines(new Float32Array(18 * count.targets), { color: 0x888888 });
// Errors are mostly inside their ellipsoids, so they are drawn over them.
const errors = lines(new Float32Array(6 * count.targets), { color: 0xff2a1a, depthTest: false });
errors.renderOrder = 2;
for (const one of [crosses, errors]) one.frustumCulled = false;
groups.ellipsoids = [bodies, crosses];
groups.errors = [errors];
scene.add(bodies, crosses, errors);
const longest = Array.from(u.keys()).map((k) => uncertainty(num.axes_mm, k).along[2]).filter(Number.isFinite).sort((a, b) => a - b);
// A magnification of 1, 2 or 5 and noughts, so that the usual ellipsoid is a twelfth of the field's radius, less where
// targets are so many that ellipsoids would touch; steps go on from it.
const usual = Math.min(0.08, 0.6 / Math.sqrt(Math.max(1, longest.length))) * radius;
const NICE = (step) => [1, 2, 5][((step % 3) + 3) % 3] * 10 ** Math.floor(step / 3);
state.base = longest.length ? Math.floor(3 * Math.log10(usual / Math.max(longest[longest.length >> 1], 1e-12))) - 12 : 0;
const factor = () => NICE(state.base + state.enlarge);

function ellipsoids() {
  const axes = num[state.whose], f = factor(), colours = new THREE.Color(), matrix = new THREE.Matrix4();
  const order = Array.from({ length: count.targets }, (_, k) => k).filter((k) => Number.isFinite(axes[9 * k]) && !(cutting && section.distanceToPoint(three(num.mark_mm, num.target[k])) < 0));
  if (order.length > BODIES) {
    const away = Float64Array.from({ length: count.targets }, (_, k) => three(num.mark_mm, num.target[k]).distanceToSquared(camera.position));
    order.sort((a, b) => away[a] - away[b]);
  }
  const drawn = order.slice(0, BODIES);
  drawn.forEach((k, i) => {
    const a = axes.subarray(9 * k, 9 * k + 9), [x, y, z] = three(num.mark_mm, num.target[k]).toArray();
    // Right-handed, for a mirrored body shows its inside.
    const det = a[0] * (a[4] * a[8] - a[5] * a[7]) - a[1] * (a[3] * a[8] - a[5] * a[6]) + a[2] * (a[3] * a[7] - a[4] * a[6]), s = det < 0 ? -f : f;
    bodies.setMatrixAt(i, matrix.set(s * a[0], f * a[1], f * a[2], x, s * a[3], f * a[4], f * a[5], y, s * a[6], f * a[7], f * a[8], z, 0, 0, 0, 1));
    bodies.setColorAt(i, colours.copy(shown(num.target[k])));
  });
  bodies.count = bodies.userData.all = drawn.length;
  bodies.instanceMatrix.needsUpdate = true;
  if (bodies.instanceColor) bodies.instanceColor.needsUpdate = true;
  const across = crosses.geometry.attributes.position, away = errors.geometry.attributes.position;
  crosses.geometry.setDrawRange(0, order.length > BODIES ? 6 * count.targets : 0);
  for (let k = 0; k < count.targets; k++) {
    const at = three(num.mark_mm, num.target[k]), good = Number.isFinite(axes[9 * k]);
    for (let c = 0; c < 3; c++) for (const [i, sign] of [[0, 1], [1, -1]]) {
      const along = good ? [axes[9 * k + c], axes[9 * k + 3 + c], axes[9 * k + 6 + c]].map((v) => sign * f * v) : [0, 0, 0];
      across.setXYZ(6 * k + 2 * c + i, at.x + along[0], at.y + along[1], at.z + along[2]);
    }
    if (!about.run) continue;
    const e = errorOf(k).map((v) => Number.isFinite(v) ? f * v : 0);
    away.setXYZ(2 * k, at.x, at.y, at.z);
    away.setXYZ(2 * k + 1, at.x + e[0], at.y + e[1], at.z + e[2]);
  }
  across.needsUpdate = away.needsUpdate = true;
}

// Rays of what is chosen, and its whole frustum.
let chosenLines = null;
const MOST_RAYS = 80, REACH = 1 / 0.12;
function rays() {
  if (chosenLines) { scene.remove(chosenLines); chosenLines.geometry.dispose(); chosenLines.material.dispose(); chosenLines = null; }
  const ends = [];
  const ray = (s, mark) => ends.push(...eyes[s].toArray(), ...three(num.mark_mm, mark).toArray());
  if (state.station >= 0) {
    const own = Array.from(seenBy(state.station)).filter((mark) => isTarget[mark] >= 0), step = Math.ceil(own.length / MOST_RAYS);
    own.forEach((mark, k) => { if (k % step === 0) ray(state.station, mark); });
    ends.push(...frustumOf(state.station, REACH));
  } else if (state.mark >= 0) seeing(state.mark).forEach((s) => ray(s, state.mark));
  if (!ends.length) return;
  chosenLines = lines(ends, { color: LIT, transparent: true, opacity: state.station >= 0 ? 0.45 : 0.8 });
  clip(chosenLines);
  scene.add(chosenLines);
}
