// Choosing, the section, the loop that draws when something has changed, and what tests may ask.
let wanted = true, moved = 0, last = 0, level = 0;
const again = () => { wanted = true; };

function choose(kind, k) {
  state.mark = kind === "mark" ? k : -1;
  state.station = kind === "station" ? k : -1;
  switches(); paint(); rays(); show(); again();
}
function setMode(name) { state.mode = name; byId("mode").value = name; switches(); paint(); legend(); again(); }

function setSection() {
  const axis = byId("cut").value, at = byId("cut_at");
  at.disabled = byId("flip").disabled = !axis;
  cutting = axis !== "";
  byId("cut_said").textContent = "";
  if (axis) {
    const side = byId("flip").dataset.side === "-" ? -1 : 1, span = 1.05 * whole;
    const place = middle[axis] + span * (at.value / 500 - 1);
    section.normal.set(0, 0, 0)[axis] = -side;
    section.constant = side * place;
    byId("cut_said").textContent = `${side > 0 ? "shown below" : "shown above"} ${axis} = ${place.toFixed(0)} mm`;
  }
  scene.traverse((one) => { if (one.material) clip(one); });
  ellipsoids(); setLevel(level); again();
}

// What lies under a place of the screen: of all within reach of it the one that is nearest to the eye.
const REACH_PX = 9, at = new THREE.Vector3();
function screenOf(xyz) {
  at.copy(xyz);
  if (cutting && section.distanceToPoint(at) < 0) return null;
  const away = at.distanceTo(camera.position);
  at.project(camera);
  if (at.z > 1 || at.z < -1) return null;
  return { x: (at.x + 1) / 2 * canvas.clientWidth, y: (1 - at.y) / 2 * canvas.clientHeight, away };
}
const canvas = renderer.domElement;
function under(x, y) {
  let best = null;
  const look = (kind, k, xyz) => {
    const on = screenOf(xyz);
    if (!on || Math.hypot(on.x - x, on.y - y) > REACH_PX) return;
    if (!best || on.away < best.away) best = { kind, k, away: on.away };
  };
  if (cameras.visible) eyes.forEach((eye, k) => look("station", k, eye));
  num.target.forEach((mark) => look("mark", mark, three(num.mark_mm, mark)));
  if (dots.visible && !(best && best.kind === "mark")) onBoards.forEach((mark) => look("mark", mark, three(num.mark_mm, mark)));
  return best;
}
let pressed = null;
canvas.addEventListener("pointerdown", (e) => { pressed = [e.clientX, e.clientY]; byId("tip").hidden = true; });
canvas.addEventListener("pointerup", (e) => {
  if (!pressed || e.button !== 0 || Math.hypot(e.clientX - pressed[0], e.clientY - pressed[1]) > 4) { pressed = null; return; }
  pressed = null;
  const box = canvas.getBoundingClientRect(), found = under(e.clientX - box.left, e.clientY - box.top);
  found ? choose(found.kind, found.k) : choose("", -1);
});
let resting = 0;
canvas.addEventListener("pointermove", (e) => {
  clearTimeout(resting);
  byId("tip").hidden = true;
  if (pressed) return;
  resting = setTimeout(() => {
    const box = canvas.getBoundingClientRect(), [x, y] = [e.clientX - box.left, e.clientY - box.top], found = under(x, y), tip = byId("tip");
    tip.hidden = !found;
    if (found) {
      tip.textContent = found.kind === "station" ? `station ${about.stations[found.k].name}` : markName(found.k);
      [tip.style.left, tip.style.top] = [`${Math.min(x + 12, canvas.clientWidth - 160)}px`, `${y + 10}px`];
    }
  }, 60);
});
canvas.addEventListener("keydown", (e) => { if (e.key === "Escape") choose("", -1); });
canvas.addEventListener("pointerleave", () => { clearTimeout(resting); byId("tip").hidden = true; });
document.querySelector("aside").addEventListener("click", (e) => {
  const { mark, station } = e.target.dataset;
  if (mark) choose("mark", Number(mark));
  if (station) choose("station", Number(station));
});
byId("mode").addEventListener("change", () => setMode(byId("mode").value));
byId("whose").addEventListener("change", () => { state.whose = byId("whose").value; ellipsoids(); again(); });
byId("enlarge").addEventListener("input", () => { state.enlarge = Number(byId("enlarge").value); ellipsoids(); legend(); again(); });
byId("shown").addEventListener("change", () => { switches(); again(); });
byId("cut").addEventListener("change", setSection);
byId("cut_at").addEventListener("input", setSection);
byId("flip").addEventListener("click", () => { byId("flip").dataset.side = byId("flip").dataset.side === "-" ? "" : "-"; setSection(); });
byId("find_station").addEventListener("change", () => choose("station", Number(byId("find_station").value)));
byId("find_target").addEventListener("change", () => {
  const k = about.targets.indexOf(byId("find_target").value.trim());
  k >= 0 ? choose("mark", num.target[k]) : byId("find_target").select();
});
function theme(name) {
  document.documentElement.dataset.theme = name;
  const style = getComputedStyle(document.documentElement), colour = (v) => new THREE.Color(style.getPropertyValue(v).trim());
  scene.background = colour("--wash");
  groups.room[0].material.color = colour("--room");
  for (const name of ["frusta", "axes"]) groups[name][0].material.color = colour("--quiet");
  crosses.material.color = colour("--quiet");
  paint(); legend(); show(); again();
}
byId("theme").addEventListener("click", () => theme(isDark() ? "light" : "dark"));
const system = matchMedia("(prefers-color-scheme: dark)");
system.addEventListener("change", () => theme(system.matches ? "dark" : "light"));

// Drawn when something has changed. A picture that moves slower than 30 frames a second is made coarser, level by level,
// until it rests: `pixels` a side of each pixel, `bodies` the most ellipsoids, `lines` whether axes and frusta are drawn.
const SLOW_MS = 34, REST_MS = 250, SLOW_FRAMES = 2;
const LEVELS = [{ pixels: 1, bodies: BODIES, lines: true }, { pixels: 1, bodies: 200, lines: true }, { pixels: 0.75, bodies: 80, lines: false }, { pixels: 0.6, bodies: 0, lines: false }, { pixels: 0.4, bodies: 0, lines: false }];
function setLevel(k) {
  const before = LEVELS[level].pixels, now = LEVELS[k];
  level = k;
  bodies.count = Math.min(bodies.userData.all, now.bodies);
  for (const one of [crosses, groups.frusta[0], groups.axes[0]]) one.material.visible = now.lines;
  if (before !== now.pixels) fit();
}
function fit() {
  const [w, h] = [canvas.parentElement.clientWidth, canvas.parentElement.clientHeight];
  renderer.setPixelRatio(Math.min(devicePixelRatio, software ? 1 : 2) * LEVELS[level].pixels);
  renderer.setSize(w, h, false);
  camera.aspect = w / Math.max(1, h);
  camera.updateProjectionMatrix();
  again();
}
new ResizeObserver(fit).observe(canvas.parentElement);
controls.addEventListener("change", () => { moved = performance.now(); again(); });
let slow = 0, held = [0, LEVELS.length - 1];
function frame(now) {
  requestAnimationFrame(frame);
  const moving = now - moved < REST_MS, took = now - last;
  last = now;
  if (moving && wanted) {
    slow = took > SLOW_MS ? slow + 1 : Math.max(0, slow - 1);
    if (slow > SLOW_FRAMES && level < held[1]) { setLevel(level + 1); slow = 0; }
  } else if (!moving && moved && !held[0]) {
    moved = slow = 0;
    if (longest.length > BODIES) ellipsoids();
    setLevel(0);
    again();
  }
  if (!wanted) return;
  wanted = false;
  renderer.render(scene, camera);
}

theme(system.matches ? "dark" : "light");
setMode(longest.length ? "u" : "rays");
fit(); home(); setSection();
requestAnimationFrame(frame);
window.view = {
  about, count, state, choose, setMode,
  // Where a mark or a station is on the canvas, in CSS pixels.
  screenOf: (kind, k) => screenOf(kind === "station" ? eyes[k] : three(num.mark_mm, k)),
  markOf: (target) => num.target[target],
  // Turns the scene once by so many frames, each of them finished; the middle time of a frame in ms, and what it left out. It is made coarser
  // as for a person, but not below `least` nor above `most` of the levels.
  spin: (frames, least = 0, most = LEVELS.length - 1) => new Promise((done) => {
    const times = [], away = camera.position.clone().sub(middle), gl = renderer.getContext(), pixel = new Uint8Array(4);
    let before = performance.now(), k = 0;
    held = [least, most];
    setLevel(least);
    const step = () => {
      gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
      const now = performance.now();
      times.push(now - before);
      before = now;
      if (k++ === frames) { held = [0, LEVELS.length - 1]; times.sort((a, b) => a - b); done({ ms: times[times.length >> 1], worst_ms: times[Math.floor(0.95 * times.length)], level, pixels: LEVELS[level].pixels, bodies: bodies.count, software }); return; }
      camera.position.copy(away).applyAxisAngle(camera.up, 2 * Math.PI * k / frames).add(middle);
      controls.update();
      requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }),
};
document.documentElement.dataset.ready = "yes";
