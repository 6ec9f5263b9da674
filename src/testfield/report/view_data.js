// The page's data: names in `about`, numbers in `num`, typed arrays that were compressed one by one.
const KINDS = { f4: Float32Array, u4: Uint32Array, u2: Uint16Array, u1: Uint8Array };

async function unpack([kind, text]) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new KINDS[kind](await new Response(stream).arrayBuffer());
}

const byId = (id) => document.getElementById(id);
const file = JSON.parse(byId("data").textContent);
const about = file.about, num = {};
for (const [name, packed] of Object.entries(file.arrays)) num[name] = await unpack(packed);
file.arrays = null;

const FINEST = 65535;
const count = { marks: num.rays.length, targets: num.target.length, stations: about.stations.length };
const three = (array, k) => new THREE.Vector3(array[3 * k], array[3 * k + 1], array[3 * k + 2]);
const isTarget = new Int32Array(count.marks).fill(-1);
num.target.forEach((mark, k) => { isTarget[mark] = k; });
const onBoards = Array.from({ length: count.marks }, (_, k) => k).filter((k) => num.mark_board[k] > 0);

// Standard uncertainties of target k: of its coordinates, of its ellipsoid's axes (shortest first), and all of it.
function uncertainty(axes, k) {
  const a = axes.subarray(9 * k, 9 * k + 9), rms = (i, step) => Math.hypot(a[i], a[i + step], a[i + 2 * step]);
  const xyz = [rms(0, 1), rms(3, 1), rms(6, 1)], along = [rms(0, 3), rms(1, 3), rms(2, 3)];
  return { xyz, along, all: Math.hypot(...xyz), longest: [a[2], a[5], a[8]].map((v) => v / (along[2] || 1)) };
}
const errorOf = (k) => [...num.error_mm.subarray(3 * k, 3 * k + 3)];

// Marks that a station sees, and stations that see a mark.
const seenBy = (station) => num.seen_mark.subarray(num.seen_first[station], num.seen_first[station + 1]);
function seeing(mark) {
  const found = [];
  for (let s = 0; s < count.stations; s++) if (seenBy(s).includes(mark)) found.push(s);
  return found;
}

function markName(mark) {
  if (isTarget[mark] >= 0) return `target ${about.targets[isTarget[mark]]}`;
  const code = num.mark_code[mark] ? `, code ${num.mark_code[mark]}` : "";
  return `board ${about.boards[num.mark_board[mark] - 1]}, mark ${num.mark_point[mark] - 1}${code}`;
}
