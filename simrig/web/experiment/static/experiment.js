"use strict";
// The order of pages; every answer waits until the server has acknowledged it.

const SAME_WIDTH = 0.03; // the two measurements may differ by this part
const SAME_CARD = 0.1;
const AHEAD = 2; // pictures that are loaded before they are needed

let token = new URLSearchParams(location.hash.slice(1)).get("session");
let pixelMm = null; // of a CSS pixel
let ratio = null; // device pixels per CSS pixel when that was measured
const notice = (text) => { document.getElementById("notice").textContent = text; };
const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

// Send a request until it is answered. Only what cannot succeed is given up.
async function ask(method, path, body) {
  for (let wait = 300; ; wait = Math.min(2 * wait, 10000)) {
    try {
      const headers = { ...(body ? { "content-type": "application/json" } : {}), ...(token ? { authorization: `Bearer ${token}` } : {}) };
      const answer = await fetch(`api/${path}`, { method, headers, body: body && JSON.stringify(body), cache: "no-store", credentials: "omit" });
      const said = await answer.json();
      if (answer.status < 500 && answer.status !== 429) {
        notice("");
        return { status: answer.status, ...said };
      }
    } catch {
      // no connection, or an answer that is none
    }
    notice("No connection to the server; your answer is kept and sent again.");
    await sleep(wait);
  }
}

function plausibleCalibration(first, second, card) {
  if (Math.abs(first - second) > SAME_WIDTH * Math.min(first, second)) return "The two measurements differ.";
  if (card !== null && Math.abs(card / ((first + second) / (2 * RECTANGLE_PX)) - 1) > SAME_CARD) return "The card and the ruler disagree.";
  return "";
}

function calibration(jsPsych) {
  // Measured twice, with the card as a check, until they agree.
  const first = { type: RectanglePlugin, number: 1 };
  const second = { type: RectanglePlugin, number: 2 };
  const card = { type: RectanglePlugin, number: 3, card: true };
  const store = {
    type: jsPsychCall,
    run: async () => {
      const [one, two, three] = jsPsych.data.get().filter({ trial_type: "rectangle" }).last(3).values();
      const problem = plausibleCalibration(one.width_mm, two.width_mm, three.pixel_mm);
      notice(problem ? `${problem} Please measure again.` : "");
      if (problem) return { agreed: false };
      pixelMm = (one.width_mm + two.width_mm) / (2 * RECTANGLE_PX);
      ratio = window.devicePixelRatio;
      await ask("PUT", "session/calibration", {
        first_mm: one.width_mm, second_mm: two.width_mm, ...(three.width_mm ? { card_mm: three.pixel_mm * RECTANGLE_PX } : {}),
        pixel_mm: pixelMm / ratio, ratio, viewport_x: window.innerWidth, viewport_y: window.innerHeight,
      });
      return { agreed: true };
    },
  };
  return { timeline: [first, second, card, store], loop_function: (data) => !data.values().at(-1).agreed };
}

class jsPsychCall {
  // Does something that takes time, shows nothing.
  static info = { name: "call", version: "1.0.0", parameters: { run: { type: Parameter.FUNCTION } }, data: {} };
  constructor(jsPsych) { this.jsPsych = jsPsych; }
  trial(display, trial) { trial.run().then((data) => this.jsPsych.finishTrial(data ?? {})); }
}

function question(jsPsych, design, own, about, after) {
  // A trial, and before it the calibration where zoom or screen have changed.
  const again = { timeline: [calibration(jsPsych)], conditional_function: () => window.devicePixelRatio !== ratio };
  const answer = {
    type: AnswerPlugin, question: design.question, answers: design.answers, pictures: own.pictures, reference: own.reference,
    width_mm: design.width_mm, pixel_mm: () => pixelMm, progress: about,
  };
  return [again, answer, { type: jsPsychCall, run: async () => after(jsPsych.data.get().filter({ trial_type: "answer" }).last(1).values()[0]) }];
}

// What subjects do with their code, later: the page at #withdraw.
function withdraw() {
  const code = element("input", { type: "text", id: "code", ariaLabel: "Code", autocomplete: "off" });
  const said = element("p", { role: "status" });
  const form = element("form", {}, code, " ", element("button", { textContent: "Delete my answers" }));
  form.onsubmit = async (event) => {
    event.preventDefault();
    const done = await ask("POST", "withdraw", { code: code.value.trim() });
    said.textContent = done.deleted ? "Everything that was stored of you is deleted." : done.error;
  };
  document.getElementById("experiment").replaceChildren(element("div", { className: "text" }, element("h1", { textContent: "Withdraw" }), "Enter the code that you got at the end.", form, said));
  code.focus();
}

async function main() {
  if (location.hash === "#withdraw") return withdraw();
  const design = await ask("GET", "design");
  document.title = design.title;
  let state = token ? await ask("GET", "session") : { status: 401 };
  if (state.status === 401) token = null;
  const jsPsych = initJsPsych({ display_element: "experiment" });
  const run = (timeline) => {
    document.getElementById("experiment").replaceChildren(); // a run leaves its frame behind
    return jsPsych.run(timeline);
  };
  const thanks = async () => {
    const done = await ask("POST", "session/finish");
    return run([{ type: PagePlugin, title: "Thank you", text: `${done.thanks}\n\nShould you change your mind, open this page again with #withdraw at the end of its address and enter this code. It deletes everything that was stored:`, code: done.code, buttons: [] }]);
  };
  if (state.finished) return thanks();
  const text = (title, body, buttons) => ({ type: PagePlugin, title, text: body, buttons });

  if (token === null) {
    await run([
      text(design.title, design.consent, ["I agree and take part"]),
      { type: jsPsychBrowserCheck, features: ["width", "height", "mobile", "fullscreen"], skip_features: ["webaudio", "vsync_rate"], inclusion_function: (data) => !data.mobile, exclusion_message: () => "<p>This experiment needs the screen of a computer.</p>" },
    ]);
    const panel = new URLSearchParams(location.search).get("panel");
    const begun = await ask("POST", "session", { consent: true, version: design.consent_version, ...(panel ? { panel } : {}) });
    if (!begun.token) return run([text("This is not possible now", begun.error, [])]);
    token = begun.token;
    history.replaceState(null, "", `#session=${token}`);
    state = await ask("GET", "session");
  }

  const timeline = [calibration(jsPsych)];
  if (document.fullscreenEnabled) {
    timeline.push({ type: jsPsychFullscreen, fullscreen_mode: true, message: "<p>The pictures need the whole screen.</p>", button_label: "Continue" });
  }
  timeline.push(text("What to do", design.instructions));
  if (state.open.length === state.trials.length) {
    for (const own of design.practice) timeline.push(...question(jsPsych, design, own, "(practice)", async () => ({})));
    if (design.practice.length) timeline.push(text("Now it counts", "That was practice. The next answers are stored.", ["Begin"]));
  }
  state.open.forEach((number, place) => {
    const own = state.trials[number];
    const about = `(${state.trials.length - state.open.length + place + 1} of ${state.trials.length})`;
    timeline.push(...question(jsPsych, design, own, about, async (data) => {
      for (const next of state.open.slice(place + 1, place + 1 + AHEAD)) {
        for (const name of state.trials[next].pictures) if (!name.endsWith(".webm")) new Image().src = `stimuli/${name}`;
      }
      const chosen = own.swapped ? design.answers.length - 1 - data.answer : data.answer;
      const stored = await ask("PUT", `session/answers/${number}`, {
        answer: own.pictures.length === 2 ? chosen : data.answer, rt_ms: data.rt_ms, shown_mm: data.shown_mm, pixel_mm: pixelMm / ratio, blurred: data.blurred,
      });
      return { stored: stored.status };
    }));
  });
  await run(timeline);
  if (document.fullscreenElement) await document.exitFullscreen();
  return thanks();
}

main();
