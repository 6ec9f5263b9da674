// Renderer, camera, and everything that stands still: panels with their prints, meshes, lamps, stations.
let renderer, software = false;
try {
  // Without a graphics card, smooth edges and oblique textures cost more than all the rest.
  const probe = document.createElement("canvas").getContext("webgl2");
  software = /swiftshader|llvmpipe|software|basic render/i.test(probe.getParameter(probe.RENDERER) + (probe.getExtension("WEBGL_debug_renderer_info") ? probe.getParameter(0x9246) : ""));
  probe.getExtension("WEBGL_lose_context")?.loseContext();
  renderer = new THREE.WebGLRenderer({ canvas: byId("canvas"), antialias: !software });
} catch (error) {
  byId("fault").hidden = false;
  byId("fault").textContent = "This browser draws no WebGL, so the scene cannot be shown; switch hardware acceleration or software rendering on.";
  throw error;
}
const scene = new THREE.Scene();
// The section cuts all but ellipsoids, which are whole or not there.
const section = new THREE.Plane(new THREE.Vector3(1, 0, 0), 0);
let cutting = false;
renderer.localClippingEnabled = true;
const clip = (one) => { one.material.clippingPlanes = cutting && !one.isInstancedMesh ? [section] : null; };
const groups = {};
const lines = (positions, options) => {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(positions), 3));
  return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial(options));
};
const grey = (albedo) => Math.round(255 * Math.min(1, Math.max(0, albedo)) ** (1 / 2.2));
// Surfaces lie a little deeper than they are, so that the markers of what is on them are not cut.
const DEEPER = { polygonOffset: true, polygonOffsetFactor: 5, polygonOffsetUnits: 20 };

// What everything is measured by: the middle of marks and its distance to the farthest mark or station.
const low = new THREE.Vector3(1e12, 1e12, 1e12), high = low.clone().negate();
for (let k = 0; k < count.marks; k++) { low.min(three(num.mark_mm, k)); high.max(three(num.mark_mm, k)); }
const middle = low.clone().add(high).multiplyScalar(0.5);
let radius = Math.max(high.distanceTo(low) / 2, 1);
const eyes = Array.from({ length: count.stations }, (_, k) => three(num.eye_mm, k));
const whole = Math.max(radius, ...eyes.map((eye) => eye.distanceTo(middle)));

const camera = new THREE.PerspectiveCamera(40, 1, whole / 500, whole * 40);
camera.up.set(0, 0, 1);
const controls = new THREE.OrbitControls(camera, renderer.domElement);
controls.listenToKeyEvents(renderer.domElement);
// From the stations' side, but off to one side and from above, so that they do not hide what they see; all in the picture.
function home() {
  const from = eyes.reduce((sum, eye) => sum.add(eye), new THREE.Vector3()).divideScalar(count.stations).sub(middle);
  if (from.length() < 1e-3 * whole) from.set(0.4, -1, 0);
  from.normalize();
  from.addScaledVector(new THREE.Vector3(-from.y, from.x, 0), 0.45).setZ(from.z + 0.4).normalize();
  const marks = Array.from({ length: count.marks }, (_, k) => three(num.mark_mm, k)), all = [...marks, ...eyes];
  const lowest = all.reduce((a, v) => a.min(v), all[0].clone()), highest = all.reduce((a, v) => a.max(v), all[0].clone());
  controls.target.copy(lowest.add(highest).multiplyScalar(0.5));
  const right = new THREE.Vector3().crossVectors(camera.up, from).normalize(), above = new THREE.Vector3().crossVectors(from, right);
  const half = Math.tan(camera.fov * Math.PI / 360), away = new THREE.Vector3();
  let distance = 0;
  for (const v of all) {
    away.copy(v).sub(controls.target);
    const across = Math.max(Math.abs(away.dot(right)) / camera.aspect, Math.abs(away.dot(above)));
    distance = Math.max(distance, away.dot(from) + 1.12 * across / half);
  }
  camera.position.copy(controls.target).addScaledVector(from, distance);
  controls.update();
}

// Prints: shapes of each panel, drawn into a canvas in mm about the panel's middle.
const byPanel = (panels) => {
  const found = new Map();
  panels.forEach((p, k) => found.has(p) ? found.get(p).push(k) : found.set(p, [k]));
  return found;
};
const prints = { dots: byPanel(num.dots_panel), sectors: byPanel(num.sectors_panel), boxes: byPanel(num.boxes_panel) };
// `part` is the middle and the width of what is drawn, all of the panel if it is not given.
function drawPrint(context, panel, left, top, width, height, part = null) {
  const [w, h] = part ? [part[2], part[2]] : [num.size_mm[2 * panel], num.size_mm[2 * panel + 1]], shade = (v) => `rgb(${grey(v)},${grey(v)},${grey(v)})`;
  context.save();
  context.beginPath();
  context.rect(left, top, width, height);
  context.clip();
  context.fillStyle = shade(num.ground[panel]);
  context.fillRect(left, top, width, height);
  context.translate(left + width / 2, top + height / 2);
  context.scale(width / w, -height / h);
  if (part) context.translate(-part[0], -part[1]);
  context.fillStyle = shade(num.ink[panel]);
  for (const k of prints.dots.get(panel) || []) {
    context.beginPath();
    context.arc(num.dots[3 * k], num.dots[3 * k + 1], num.dots[3 * k + 2], 0, 2 * Math.PI);
    context.fill();
  }
  for (const k of prints.sectors.get(panel) || []) {
    const [x, y, inner, outer, first, last] = num.sectors.subarray(6 * k, 6 * k + 6);
    context.beginPath();
    context.arc(x, y, outer, first, last);
    context.arc(x, y, inner, last, first, true);
    context.fill();
  }
  for (const k of prints.boxes.get(panel) || []) {
    const [l, b, r, t] = num.boxes.subarray(4 * k, 4 * k + 4);
    context.fillRect(l, b, r - l, t - b);
  }
  context.restore();
}
function texture(width, height) {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [width, height];
  const made = new THREE.CanvasTexture(canvas);
  made.colorSpace = THREE.SRGBColorSpace;
  made.anisotropy = software ? 1 : 4;
  return [made, canvas.getContext("2d")];
}

// A panel as vertices: 2 by 2 of a flat one, 13 by 13 of a bent one.
const panels = new Map();
num.flat.forEach((p, k) => panels.set(p, { n: 2, xyz: num.flat_mm.subarray(12 * k, 12 * k + 12) }));
const BENT = num.bent.length ? Math.round(Math.sqrt(num.bent_mm.length / 3 / num.bent.length)) : 0;
num.bent.forEach((p, k) => panels.set(p, { n: BENT, xyz: num.bent_mm.subarray(3 * BENT * BENT * k, 3 * BENT * BENT * (k + 1)) }));

// Many panels as one mesh; `window` gives the part of the texture that is a panel's, `colour` its colour.
function merged(some, material, window, colour) {
  const xyz = [], uv = [], index = [], rgb = [];
  for (const p of some) {
    const { n, xyz: own } = panels.get(p), begin = xyz.length / 3;
    for (const v of own) xyz.push(v);
    const [u0, v0, u1, v1] = window ? window(p) : [0, 0, 1, 1];
    const shade = colour ? new THREE.Color(`rgb(${grey(colour(p))},${grey(colour(p))},${grey(colour(p))})`) : null;
    for (let r = 0; r < n; r++) for (let c = 0; c < n; c++) {
      uv.push(u0 + (u1 - u0) * c / (n - 1), v0 + (v1 - v0) * r / (n - 1));
      if (shade) rgb.push(shade.r, shade.g, shade.b);
    }
    for (let r = 0; r + 1 < n; r++) for (let c = 0; c + 1 < n; c++) {
      const a = begin + r * n + c;
      index.push(a, a + 1, a + n, a + 1, a + n + 1, a + n);
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(xyz), 3));
  geometry.setAttribute("uv", new THREE.BufferAttribute(new Float32Array(uv), 2));
  if (colour) geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(rgb), 3));
  geometry.setIndex(index);
  return new THREE.Mesh(geometry, material);
}

const marked = new Set(num.mark_panel), boardPanels = new Set(onBoards.map((k) => num.mark_panel[k]));
const TEXELS = 24e6, ATLAS = 2048, OWN_CARDS = 40;
{
  groups.boards = [];
  // Boards and long cards, as bars are, have a texture each; other cards share one.
  const long = [...marked].filter((p) => !boardPanels.has(p) && Math.max(num.size_mm[2 * p] / num.size_mm[2 * p + 1], num.size_mm[2 * p + 1] / num.size_mm[2 * p]) > 1.5);
  const own = new Set([...boardPanels, ...long.slice(0, OWN_CARDS)]);
  const each = Math.min(2048, Math.sqrt(TEXELS / Math.max(1, own.size)));
  for (const p of own) {
    const [w, h] = [num.size_mm[2 * p], num.size_mm[2 * p + 1]], unit = each / Math.max(w, h);
    const [map, context] = texture(Math.max(2, Math.round(w * unit)), Math.max(2, Math.round(h * unit)));
    drawPrint(context, p, 0, 0, map.image.width, map.image.height);
    groups.boards.push(merged([p], new THREE.MeshBasicMaterial({ map, ...DEEPER })));
  }
  const cards = [...marked].filter((p) => !own.has(p));
  if (cards.length) {
    const across = Math.ceil(Math.sqrt(cards.length)), cell = Math.min(256, Math.floor(ATLAS / across));
    const [map, context] = texture(cell * across, cell * across), side = 1 / across;
    const at = new Map(cards.map((p, k) => [p, [k % across, Math.floor(k / across)]]));
    for (const p of cards) drawPrint(context, p, at.get(p)[0] * cell, at.get(p)[1] * cell, cell, cell);
    const edge = 0.5 / map.image.width;
    groups.boards.push(merged(cards, new THREE.MeshBasicMaterial({ map, ...DEEPER }), (p) => {
      const [c, r] = at.get(p);
      return [c * side + edge, 1 - (r + 1) * side + edge, (c + 1) * side - edge, 1 - r * side - edge];
    }));
    if (cell < 48) about.notes.push(`codes on the ${cards.length.toLocaleString("en")} cards are drawn ${cell} texels wide, too few to be read; a click on a target draws its code`);
  }
  const blank = [...panels.keys()].filter((p) => !marked.has(p));
  const plain = { vertexColors: true, ...DEEPER };
  groups.boards.push(merged(blank.filter((p) => !num.of_room[p]), new THREE.MeshBasicMaterial(plain), null, (p) => num.ground[p]));
  groups.room = [merged(blank.filter((p) => num.of_room[p]), new THREE.MeshBasicMaterial({ polygonOffset: true, polygonOffsetFactor: 8, polygonOffsetUnits: 60 }))];
}

// Meshes and lamps.
groups.meshes = [];
let firstVertex = 0, firstFace = 0;
for (const mesh of about.meshes) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(num.vertices_mm.slice(3 * firstVertex, 3 * (firstVertex + mesh.vertices)), 3));
  geometry.setIndex(new THREE.BufferAttribute(num.faces.slice(3 * firstFace, 3 * (firstFace + mesh.faces)), 1));
  geometry.computeVertexNormals();
  const g = grey(0.3 + 0.5 * mesh.albedo);
  groups.meshes.push(new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color: `rgb(${g},${g},${g})`, side: THREE.DoubleSide, flatShading: true, ...DEEPER })));
  firstVertex += mesh.vertices;
  firstFace += mesh.faces;
}
scene.add(new THREE.AmbientLight(0xffffff, 1.4));
const sun = new THREE.DirectionalLight(0xffffff, 1.8);
camera.add(sun);
sun.position.set(-0.4, 0.6, 1);
scene.add(camera);
{
  const edges = [];
  for (let k = 0; k < num.lamps_mm.length / 12; k++) for (const [a, b] of [[0, 1], [1, 3], [3, 2], [2, 0], [0, 3], [1, 2]]) for (const c of [a, b]) edges.push(...num.lamps_mm.subarray(12 * k + 3 * c, 12 * k + 3 * c + 3));
  groups.lamps = [lines(edges, { color: 0xd9a520 })];
}

// Stations: a frustum each, as far as a part of what they see, and the optical axis all the way.
const frustumOf = (k, stretch = 1) => {
  const eye = eyes[k], ends = [0, 1, 2, 3].map((c) => three(num.frustum_mm, 4 * k + c).sub(eye).multiplyScalar(stretch).add(eye));
  const found = [];
  ends.forEach((end, c) => found.push(...eye.toArray(), ...end.toArray(), ...end.toArray(), ...ends[(c + 1) % 4].toArray()));
  return found;
};
groups.frusta = [lines(eyes.flatMap((_, k) => frustumOf(k)), { color: 0x888888, transparent: true, opacity: count.stations > 40 ? 0.45 : 0.9 })];
groups.axes = [lines(eyes.flatMap((eye, k) => [...eye.toArray(), ...three(num.axis, k).multiplyScalar(num.reach_mm[k]).add(eye).toArray()]), { color: 0x888888, transparent: true, opacity: 0.35 })];
groups.bars = [lines(about.bars.flatMap((bar) => bar.ends.flatMap((k) => three(num.mark_mm, num.target[k]).toArray())), { color: 0xc4502a })];
for (const group of Object.values(groups)) for (const one of group) scene.add(one);
