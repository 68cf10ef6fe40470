"use strict";
// The lamp follows the mouse: coarse pictures while it moves, a fine one when it rests.

const COARSE = 96, FINE = 256, REST_MS = 80;
const COLOURS = ["#4aa3df", "#ff6b5e", "#5fd35f", "#b79ae0", "#ffab4a", "#4fd6e0", "#c49a8a", "#f29ad2"];
const token = new URLSearchParams(location.hash.slice(1)).get("token");
const $ = (id) => document.getElementById(id);
const state = { form: "sphere", theta: 40, phi: 60, rotation: 0, zoom: 1, theta_i: 30, phi_i: 0, phi_v: 180 };
let names = [], canvases = [], frame = null, busy = false, again = null, rest = 0;
window.viewerTimes = []; // from a wish to its picture, for tests

const notice = (text) => { $("notice").textContent = text; };
const exposure = () => 2 ** Number($("exposure").value);

async function ask(path, body) {
  const headers = { authorization: `Bearer ${token}`, ...(body ? { "content-type": "application/json" } : {}) };
  const answer = await fetch(`api/${path}`, { method: body ? "POST" : "GET", headers, body: body && JSON.stringify(body), cache: "no-store", credentials: "omit" });
  if (!answer.ok) throw new Error((await answer.json()).error ?? (answer.status === 401 ? "Open the address that 'simrig view' printed." : `error ${answer.status}`));
  return answer;
}

// One request at a time; of all wishes meanwhile only the newest is kept.
async function draw(resolution) {
  if (busy) { again = resolution; return; }
  busy = true;
  const begun = performance.now();
  try {
    const answer = await ask("picture", { ...state, resolution, exposure: exposure() });
    if (answer.status === 200) {
      frame = parse(await answer.arrayBuffer());
      paint();
      window.viewerTimes.push([resolution, performance.now() - begun]);
      notice("");
    }
  } catch (error) {
    notice(String(error.message));
  }
  busy = false;
  if (again !== null) {
    const next = again;
    again = null;
    draw(next);
  } else if (resolution !== FINE) {
    clearTimeout(rest);
    rest = setTimeout(() => draw(FINE), REST_MS);
  }
}

function parse(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  return { ...head, halves: new Uint16Array(buffer, 4 + length) };
}

const HALF = Float32Array.from({ length: 65536 }, (_, h) => {
  const sign = h & 0x8000 ? -1 : 1, exponent = (h >> 10) & 31, part = h & 1023;
  if (exponent === 0) return sign * part * 2 ** -24;
  return exponent === 31 ? (part ? NaN : sign * Infinity) : sign * (1 + part / 1024) * 2 ** (exponent - 15);
});
const encode = (v) => 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * Math.min(v, 1) ** (1 / 2.4) - 0.055);

// The byte that a half becomes, for every half: made anew when exposure or scale change.
let table = new Uint8ClampedArray(65536), made = "";
function bytesOfHalves() {
  const factor = exposure(), log = $("log").checked, now = `${factor} ${log}`;
  if (now !== made) for (let h = 0; h < 65536; h += 1) table[h] = encode(log ? Math.log10(1 + factor * HALF[h]) : factor * HALF[h]);
  made = now;
  return table;
}

function shown(number) {
  // 8-bit RGB of one material as the controls say.
  const { width, height, halves } = frame, count = width * height, from = number * count * 3;
  const bytes = new Uint8ClampedArray(count * 4), channels = $("channels").value, byte = bytesOfHalves();
  const one = "RGB".indexOf(channels), factor = exposure(), log = $("log").checked;
  for (let n = 0, at = from; n < count; n += 1, at += 3) {
    if (channels === "luminance") {
      const y = factor * (0.2126 * HALF[halves[at]] + 0.7152 * HALF[halves[at + 1]] + 0.0722 * HALF[halves[at + 2]]);
      bytes.fill(encode(log ? Math.log10(1 + y) : y), 4 * n, 4 * n + 3);
    } else for (let c = 0; c < 3; c += 1) bytes[4 * n + c] = byte[halves[at + (channels === "RGB" ? c : one)]];
    bytes[4 * n + 3] = 255;
  }
  return bytes;
}

function paint() {
  const all = names.map((_, n) => shown(n));
  const put = (canvas, bytes) => {
    if (canvas.width !== frame.width || canvas.height !== frame.height) Object.assign(canvas, { width: frame.width, height: frame.height });
    canvas.style.width = "320px";
    canvas.style.height = `${(320 * frame.height) / frame.width}px`;
    canvas.getContext("2d").putImageData(new ImageData(bytes, frame.width, frame.height), 0, 0);
  };
  all.forEach((bytes, n) => put(canvases[n].picture, bytes));
  all.slice(1).forEach((bytes, k) => {
    const { difference, said } = canvases[k + 1];
    difference.parentElement.hidden = !$("difference").checked;
    const scale = Number($("scale").value);
    const apart = new Uint8ClampedArray(bytes.length), first = all[0];
    for (let i = 0; i < bytes.length; i += 1) apart[i] = i % 4 === 3 ? 255 : 255 - scale * Math.abs(bytes[i] - first[i]);
    put(difference, apart);
    said.textContent = `${names[k + 1]}: 255 − ${scale}·|difference to ${names[0]}|, mean ΔE ${frame.delta_e[k].toFixed(3)}`;
  });
}

async function slices() {
  const data = await (await ask("slices", state)).json();
  for (const id of ["theta_i", "phi_i", "phi_v"]) $(id).nextElementSibling.textContent = `${$(id).value}°`;
  const value = (rgb, view) => {
    const mean = ((rgb[0] + rgb[1] + rgb[2]) / 3) * ($("cosine").checked ? Math.cos((view * Math.PI) / 180) : 1);
    return $("slicelog").checked ? Math.log10(1 + mean) : mean;
  };
  const curves = data.values.map((rows) => rows.map((rgb, n) => value(rgb, data.views[n])));
  const most = Math.max(1e-9, ...curves.flat());
  plot($("cartesian"), curves, (v, n, w, h) => [40 + ((data.views[n] + 90) / 180) * (w - 50), h - 24 - (v / most) * (h - 44)], most);
  plot($("polar"), curves, (v, n, w, h) => {
    const angle = (data.views[n] * Math.PI) / 180, radius = (v / most) * Math.min(h - 50, w / 2 - 20);
    return [w / 2 + radius * Math.sin(angle), h - 20 - radius * Math.cos(angle)];
  }, most);
  $("albedo").replaceChildren(...names.map((name, n) => {
    const row = document.createElement("tr");
    for (const text of [name, `albedo at ${state.theta_i}°`, data.albedo[n].map((v) => v.toFixed(4)).join("  ")]) row.insertCell().textContent = text;
    row.cells[0].style.color = COLOURS[n % COLOURS.length];
    return row;
  }));
}

function plot(canvas, curves, place, most) {
  const pen = canvas.getContext("2d"), { width, height } = canvas;
  pen.clearRect(0, 0, width, height);
  pen.fillStyle = "#aaa";
  pen.fillText(`${$("slicelog").checked ? "log10(1 + f_r)" : "f_r / sr⁻¹"}, at most ${most.toPrecision(3)}; light from ${state.theta_i}°, ${state.phi_i}°`, 40, 12);
  for (const angle of [-90, -60, -30, 0, 30, 60, 90]) if (canvas.id === "cartesian") pen.fillText(`${angle}°`, 30 + ((angle + 90) / 180) * (width - 50), height - 8);
  curves.forEach((curve, n) => {
    pen.strokeStyle = COLOURS[n % COLOURS.length];
    pen.beginPath();
    curve.forEach((v, k) => pen.lineTo(...place(v, k, width, height)));
    pen.stroke();
  });
}

function lamp(event, canvas) {
  const box = canvas.getBoundingClientRect();
  const x = (2 * (event.clientX - box.left)) / box.width - 1, y = 1 - (2 * (event.clientY - box.top)) / box.height;
  state.theta = Math.min(180, Math.hypot(x, y) * 90);
  state.phi = (Math.atan2(y, x) * 180) / Math.PI;
  draw(COARSE);
}

function keys(event) {
  const step = { ArrowUp: [-5, 0], ArrowDown: [5, 0], ArrowLeft: [0, 5], ArrowRight: [0, -5] }[event.key];
  if (!step) return;
  event.preventDefault();
  state.theta = Math.min(180, Math.max(0, state.theta + step[0]));
  state.phi = (state.phi + step[1] + 360) % 360;
  draw(COARSE);
}

function save(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

function pictureFile() {
  const all = [...document.querySelectorAll("#pictures figure:not([hidden]) canvas")];
  const sheet = Object.assign(document.createElement("canvas"), { width: all.reduce((sum, c) => sum + c.width, 0), height: Math.max(...all.map((c) => c.height)) });
  let x = 0;
  for (const canvas of all) {
    sheet.getContext("2d").drawImage(canvas, x, 0);
    x += canvas.width;
  }
  sheet.toBlob((blob) => save(blob, "view.png"));
}

function figure(canvas, text) {
  const made = document.createElement("figure"), said = document.createElement("figcaption");
  said.textContent = text;
  made.append(canvas, said);
  $("pictures").append(made);
  return said;
}

async function main() {
  names = (await (await ask("materials")).json()).map((m) => m.name);
  document.title = names.join(", ");
  canvases = names.map((name, n) => {
    const picture = document.createElement("canvas");
    Object.assign(picture, { className: "light", tabIndex: 0, ariaLabel: `${name}: drag or arrow keys move the lamp` });
    picture.onpointerdown = (event) => { picture.setPointerCapture(event.pointerId); lamp(event, picture); };
    picture.onpointermove = (event) => { if (event.buttons) lamp(event, picture); };
    picture.onkeydown = keys;
    figure(picture, name).style.color = COLOURS[n % COLOURS.length];
    return { picture };
  });
  for (const own of canvases.slice(1)) {
    own.difference = document.createElement("canvas");
    own.said = figure(own.difference, "");
  }
  const settle = (work) => () => Promise.resolve(work()).catch((error) => notice(String(error.message)));
  $("form").onchange = () => { state.form = $("form").value; draw(COARSE); };
  $("rotation").oninput = () => { state.rotation = Number($("rotation").value); draw(COARSE); };
  $("distance").oninput = () => {
    state.zoom = 2 ** -Number($("distance").value);
    $("distance-said").textContent = `× ${(1 / state.zoom).toPrecision(2)}`;
    draw(COARSE);
  };
  $("exposure").oninput = () => { $("exposure-said").textContent = $("exposure").value; paint(); };
  $("exposure").onchange = () => draw(FINE);
  for (const id of ["channels", "log", "difference", "scale"]) $(id).oninput = paint;
  for (const id of ["theta_i", "phi_i", "phi_v"]) $(id).oninput = settle(() => { state[id] = Number($(id).value); return slices(); });
  for (const id of ["cosine", "slicelog"]) $(id).oninput = settle(slices);
  $("png").onclick = pictureFile;
  const page = async () => (await ask("page", { ...state, resolution: FINE, exposure: exposure() })).text();
  $("page").onclick = settle(async () => save(new Blob([await page()], { type: "text/html" }), "view.html"));
  $("command").onclick = settle(async () => notice(await (await ask("command", { ...state, exposure: exposure() })).text()));
  $("subspaces").onclick = settle(async () => {
    const all = await Promise.all(names.map(async (_, n) => URL.createObjectURL(await (await ask(`figure/${n}`)).blob())));
    $("figures").replaceChildren(...all.map((src, n) => Object.assign(new Image(), { src, alt: `${names[n]}: all subspaces` })));
  });
  $("exposure-said").textContent = "0";
  await draw(COARSE);
  // show it as bright as it can be shown: the brightest of the first picture becomes white
  const most = frame.halves.reduce((a, b) => Math.max(a, HALF[b]), 0);
  $("exposure").value = Math.max(-8, Math.min(12, -Math.log2(most || 1)));
  $("exposure").oninput();
  await slices();
}

main().catch((error) => notice(String(error.message)));
