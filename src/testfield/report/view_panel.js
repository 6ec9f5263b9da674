// The panel beside the picture: modes, legends, switches, the section, and the numbers of what is chosen.
const said = (v, digits = 3) => !Number.isFinite(v) ? "–" : v !== 0 && Math.abs(v) < 1e-3 ? v.toExponential(2) : Number(v.toPrecision(digits)).toString();
const mm = (v) => Number.isFinite(v) ? v.toFixed(4) : "–";
const escaped = (text) => String(text).replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);
const table = (head, rows) => `<table>${head ? `<tr>${head.map((h) => `<th>${h}</th>`).join("")}</tr>` : ""}${rows.map((r) => `<tr>${r.map((c) => `<td>${c}</td>`).join("")}</tr>`).join("")}</table>`;

byId("mode").innerHTML = Object.entries(MODES).map(([name, mode]) => `<option value="${name}">${mode.title}</option>`).join("");
byId("whose").innerHTML = `<option value="axes_mm">predicted</option>${about.run ? '<option value="stated_mm">stated by the run</option>' : ""}`;
byId("whose").hidden = !about.run;
const SWITCHES = {
  boards: ["boards and cards", true], dots: ["marks of boards", count.targets === 0], meshes: ["meshes", true], room: ["floor and walls", true], lamps: ["lamps", true],
  cameras: ["stations", true], frusta: ["frusta", true], axes: ["optical axes", count.stations <= 40], bars: ["scale bars", true], ellipsoids: ["ellipsoids", true], errors: ["actual errors", true],
};
const FILLED = { meshes: about.meshes.length, room: num.of_room.some((v) => v), lamps: num.lamps_mm.length, bars: about.bars.length, ellipsoids: longest.length, errors: about.run, dots: onBoards.length };
for (const [name, [title, on]] of Object.entries(SWITCHES)) {
  if (name in FILLED && !FILLED[name]) { groups[name].forEach((one) => { one.visible = false; }); continue; }
  byId("shown").insertAdjacentHTML("beforeend", `<label class="tick"><input type="checkbox" data-group="${name}"${on ? " checked" : ""}>${title}</label>`);
}
function switches() {
  for (const box of document.querySelectorAll("[data-group]")) groups[box.dataset.group].forEach((one) => { one.visible = box.checked; });
  if (state.station >= 0 || (!MODES[state.mode].kinds && !count.targets)) dots.visible = onBoards.length > 0;
}

function legend() {
  const mode = MODES[state.mode], to = byId("legend");
  if (mode.kinds) {
    const used = about.roles.filter((role, k) => role !== "board" && Array.from(num.target).some((m) => num.mark_role[m] === k));
    to.innerHTML = `<div class="kinds">${used.map((role) => `<span><i style="background:${KIND[role]}"></i>${{ bar: "end of a scale bar", check: "check target" }[role]}</span>`).join("")}</div>`;
  } else if (!scale) to.innerHTML = '<p class="quiet">nothing to show: see below</p>';
  else {
    const steps = Array.from({ length: 9 }, (_, k) => `#${viridis(mode.down ? 1 - k / 8 : k / 8).getHexString()}`), form = (v) => `${mode.whole ? v : said(v)}${mode.unit === "°" ? "°" : mode.unit ? ` ${mode.unit}` : ""}`;
    const none = Array.from(num.target).some((m) => !Number.isFinite(mode.of(m)));
    to.innerHTML = `<div class="bar" style="background:linear-gradient(90deg,${steps})"></div><div class="ends"><span>${form(scale.first)}</span>${none ? `<span><i style="background:${NONE}"></i>${mode.none}</span>` : ""}<span>${form(scale.last)}</span></div>`;
  }
  byId("enlarge").value = state.enlarge;
  byId("enlarged").textContent = longest.length ? `k = 1, ${factor() < 1 ? factor() : factor().toLocaleString("en")} times enlarged` : "none predicted";
  byId("enlarge").disabled = !longest.length;
}

function targetNumbers(k) {
  const mark = num.target[k], found = uncertainty(num.axes_mm, k), at = three(num.mark_mm, mark).toArray();
  const axes = ["x", "y", "z"], head = ["", ...axes], rows = [["place, mm", ...at.map((v) => v.toFixed(2))]];
  if (Number.isFinite(found.all)) rows.push(["predicted u, mm", ...found.xyz.map(mm)]);
  if (about.run) {
    rows.push(["actual error, mm", ...errorOf(k).map(mm)]);
    const own = uncertainty(num.stated_mm, k);
    if (Number.isFinite(own.all)) rows.push(["stated u, mm", ...own.xyz.map(mm)]);
  }
  const bar = about.bars.find((one) => one.ends.includes(k));
  const facts = [["diameter, mm", said(num.diameter_mm[mark])], ["seen by", `${num.rays[mark]} image${num.rays[mark] === 1 ? "" : "s"}`], ["widest angle of rays", num.rays[mark] > 1 ? `${num.angle_deg[mark].toFixed(0)}°` : "–"]];
  if (Number.isFinite(found.all)) {
    facts.push(["half-axes, mm", [...found.along].reverse().map(mm).join(" · ")], ["longest along", found.longest.map((v) => v.toFixed(2)).join(" ")], ["u of the place, mm", mm(found.all)]);
  }
  if (about.run && Number.isFinite(size[k])) facts.push(["actual error, mm", mm(size[k])], ["error over predicted u", said(size[k] / found.all)]);
  if (bar) facts.push(["scale bar", `${escaped(bar.name)}, ${bar.role}, ${bar.length_mm} mm ± ${bar.u_length_mm}`]);
  return table(head, rows) + table(null, facts);
}

function show() {
  const to = byId("chosen");
  if (state.mark >= 0) {
    const mark = state.mark, k = isTarget[mark], saw = seeing(mark);
    to.innerHTML = `<div class="head"><h2>${escaped(markName(mark).replace(/^./, (c) => c.toUpperCase()))}</h2><canvas width="128" height="128"></canvas></div>`
      + (k >= 0 ? `<p class="quiet">${{ bar: "end of a scale bar", check: "check target" }[about.roles[num.mark_role[mark]]]}</p>${targetNumbers(k)}`
        : table(null, [["seen by", `${num.rays[mark]} images`], ["widest angle of rays", num.rays[mark] > 1 ? `${num.angle_deg[mark].toFixed(0)}°` : "–"], ["place, mm", three(num.mark_mm, mark).toArray().map((v) => v.toFixed(2)).join(" ")]]))
      + `<div class="list">${saw.map((s) => `<a data-station="${s}">${escaped(about.stations[s].name)}</a>`).join("") || "no station sees it"}</div>`;
    const wide = num.diameter_mm[mark] * (num.mark_code[mark] ? 4 : 3);
    drawPrint(to.querySelector("canvas").getContext("2d"), num.mark_panel[mark], 0, 0, 128, 128, [num.mark_xy[2 * mark], num.mark_xy[2 * mark + 1], wide]);
  } else if (state.station >= 0) {
    const s = state.station, seen = Array.from(seenBy(s)), own = seen.filter((m) => isTarget[m] >= 0), station = about.stations[s];
    to.innerHTML = `<h2>Station ${escaped(station.name)}</h2>${station.camera ? `<p class="quiet">camera ${escaped(station.camera)}</p>` : ""}<canvas class="drawing" title="larger"></canvas>`
      + table(null, [["place, mm", eyes[s].toArray().map((v) => v.toFixed(0)).join(" ")], ["targets seen", `${own.length} of ${count.targets}`], ["marks of boards seen", seen.length - own.length], ["image, px", station.size_px.join(" × ")], ["median distance, mm", num.reach_mm[s].toFixed(0)]])
      + `<div class="list">${own.slice(0, 400).map((m) => `<a data-mark="${m}">${escaped(about.targets[isTarget[m]])}</a>`).join("")}${own.length > 400 ? ` and ${own.length - 400} more` : ""}</div>`;
    const canvas = to.querySelector("canvas");
    draw(canvas, s, 300, false);
    canvas.onclick = () => {
      const wide = Math.min(innerWidth * 0.9, (innerHeight * 0.8 * station.size_px[0]) / station.size_px[1]);
      byId("large").showModal();
      draw(byId("large").querySelector("canvas"), s, wide, true);
      byId("large").querySelector("p").textContent = `Image of station ${station.name}: outlines of its targets, boards and their marks where the lens puts them, to a tenth of a pixel.`;
    };
  } else to.innerHTML = "";
  byId("find_station").value = state.station;
}

// The outline drawing of a station's image.
function draw(canvas, s, wide, named) {
  const [w, h] = about.stations[s].size_px, sharp = 2, unit = wide / w, px = Math.max(...about.stations.map((one) => Math.max(...one.size_px))) / FINEST;
  [canvas.width, canvas.height] = [wide * sharp, h * unit * sharp];
  [canvas.style.width, canvas.style.height] = [`${wide}px`, `${h * unit}px`];
  const context = canvas.getContext("2d"), style = getComputedStyle(document.documentElement), colour = (name) => style.getPropertyValue(name);
  context.scale(sharp * unit, sharp * unit);
  context.lineWidth = 1 / unit;
  context.strokeStyle = colour("--quiet");
  const points = num.outline_px.length / 2 / Math.max(1, num.outline_image.length);
  num.outline_image.forEach((image, o) => {
    if (image !== s) return;
    context.beginPath();
    for (let k = 0; k < points; k++) context.lineTo(num.outline_px[2 * (o * points + k)], num.outline_px[2 * (o * points + k) + 1]);
    context.closePath();
    context.stroke();
  });
  for (let d = num.drawn_first[s]; d < num.drawn_first[s + 1]; d++) {
    const mark = num.seen_mark[num.drawn[d]], x = num.drawn_xy[2 * d] * px, y = num.drawn_xy[2 * d + 1] * px, least = 0.8 / unit;
    const target = isTarget[mark] >= 0;
    context.strokeStyle = context.fillStyle = target ? colour("--accent") : colour("--ink");
    context.beginPath();
    if (num.corner[mark]) { context.moveTo(x - 3 * least, y); context.lineTo(x + 3 * least, y); context.moveTo(x, y - 3 * least); context.lineTo(x, y + 3 * least); }
    else context.ellipse(x, y, Math.max(least, num.drawn_axes[2 * d] * px), Math.max(least, num.drawn_axes[2 * d + 1] * px), num.drawn_angle[d] * Math.PI / 255, 0, 2 * Math.PI);
    context.stroke();
    if (!named || !(target || num.mark_code[mark])) continue;
    context.font = `${11 / unit}px sans-serif`;
    context.fillText(target ? about.targets[isTarget[mark]] : num.mark_code[mark], x + num.drawn_axes[2 * d] * px + 3 / unit, y + 4 / unit);
  }
}

const all = [...about.notes];
if (longest.length > BODIES) all.push(`ellipsoids are bodies for the ${BODIES.toLocaleString("en")} targets nearest to the eye, and their three axes for all ${longest.length.toLocaleString("en")}`);
if (count.targets > 0) all.push("while the picture moves slower than 30 frames a second, ellipsoids, frusta and axes are left out and pixels are larger, until it rests");
if (count.targets > MOST_RAYS) all.push(`of a station's rays ${MOST_RAYS} or fewer are drawn; all that it sees stays bright`);
if (about.times > 1) all.push(`targets that move stand in all ${about.times} places`);
if (about.run) {
  const good = Array.from(size).map((e, k) => [e, u[k]]).filter(([e, p]) => Number.isFinite(e) && Number.isFinite(p)), rms = (i) => Math.sqrt(good.reduce((sum, row) => sum + row[i] ** 2, 0) / good.length);
  byId("summary").textContent = `A finished run, measured by '${about.run.method}'${about.run.fitted ? " and fitted to the truth, for its network is free" : ""}: ${good.length} of ${count.targets} targets. Their actual errors are ${mm(rms(0))} mm rms, where ${mm(rms(1))} mm was predicted (all three axes together).`;
}
byId("notes").innerHTML = all.length ? `<h2>Notes</h2><ul>${all.map((one) => `<li>${escaped(one)}</li>`).join("")}</ul>` : "";
byId("codes").innerHTML = count.targets <= 6000 ? about.targets.map((name) => `<option>${escaped(name)}`).join("") : "";
byId("find_station").innerHTML = `<option value="-1">–</option>${about.stations.map((one, k) => `<option value="${k}">${escaped(one.name)}`).join("")}`;
