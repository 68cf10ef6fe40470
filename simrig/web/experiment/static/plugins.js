"use strict";
// jsPsych plugins of our own: a page of text, the calibration rectangle, and the question.

const Parameter = jsPsychModule.ParameterType;
const RECTANGLE_PX = 500; // CSS pixels, as in the thesis
const CARD_MM = [85.6, 53.98]; // ISO/IEC 7810 ID-1
const MM = { mm: 1, cm: 10, inches: 25.4 };

function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}

class PagePlugin {
  // A text and buttons; the first has the focus.
  static info = {
    name: "page",
    version: "1.0.0",
    parameters: { title: { type: Parameter.STRING }, text: { type: Parameter.STRING }, code: { type: Parameter.STRING, default: "" }, buttons: { type: Parameter.STRING, array: true, default: ["Continue"] } },
    data: { button: { type: Parameter.INT }, rt: { type: Parameter.INT } },
  };
  constructor(jsPsych) { this.jsPsych = jsPsych; }
  trial(display, trial) {
    const start = performance.now();
    const text = element("div", { className: "text" }, element("h1", { textContent: trial.title }), element("div", { textContent: trial.text }));
    if (trial.code) text.append(element("p", {}, element("code", { textContent: trial.code })));
    const buttons = trial.buttons.map((label, number) => element("button", {
      textContent: label,
      onclick: () => this.jsPsych.finishTrial({ button: number, rt: Math.round(performance.now() - start) }),
    }));
    display.replaceChildren(text, element("div", { className: "choices" }, ...buttons));
    buttons[0]?.focus();
  }
}

class RectanglePlugin {
  // The width of a rectangle of 500 CSS pixels, measured with a ruler; or a card laid on the screen.
  static info = {
    name: "rectangle",
    version: "1.0.0",
    parameters: { number: { type: Parameter.INT }, card: { type: Parameter.BOOL, default: false } },
    data: { width_mm: { type: Parameter.FLOAT }, pixel_mm: { type: Parameter.FLOAT } },
  };
  constructor(jsPsych) { this.jsPsych = jsPsych; }
  trial(display, trial) { trial.card ? this.card(display) : this.ruler(display, trial); }

  ruler(display, trial) {
    const drawn = element("div", { className: "rectangle", id: "rectangle" });
    drawn.style.width = `${RECTANGLE_PX}px`;
    const width = element("input", { type: "text", inputMode: "decimal", id: "width", autocomplete: "off" });
    const unit = element("select", { id: "unit" }, ...["", "mm", "cm", "inches"].map((u) => element("option", { value: u, textContent: u || "unit?" })));
    const fault = element("p", { className: "fault", role: "alert" });
    const form = element("form", { noValidate: true },
      element("label", { htmlFor: "width", textContent: "Width: " }), width, " ",
      element("label", { htmlFor: "unit", textContent: "in " }), unit, " ",
      element("button", { textContent: "Continue" }));
    form.onsubmit = (event) => {
      event.preventDefault();
      const typed = Number(width.value.trim().replace(",", "."));
      const mm = typed * (MM[unit.value] ?? NaN);
      const problem = !unit.value ? "Say in which unit you measured." : implausible(mm);
      if (problem) { fault.textContent = problem; return; }
      this.jsPsych.finishTrial({ width_mm: mm, pixel_mm: mm / RECTANGLE_PX });
    };
    display.replaceChildren(
      element("div", { className: "text" },
        element("h1", { textContent: trial.number === 1 ? "How large is your screen?" : "Once more, please" }),
        element("div", { textContent: trial.number === 1 ? "Measure the width of the bright rectangle with a ruler, to half a millimetre." : "Measure the rectangle a second time." })),
      drawn, form, fault);
    width.focus();
  }

  card(display) {
    const drawn = element("div", { className: "rectangle card", id: "card" });
    const slider = element("input", { type: "range", min: 150, max: 1200, step: 1, value: 324, ariaLabel: "Width" });
    const size = () => {
      drawn.style.width = `${slider.value}px`;
      drawn.style.height = `${(slider.value * CARD_MM[1]) / CARD_MM[0]}px`;
    };
    slider.oninput = size;
    size();
    const finish = (used) => this.jsPsych.finishTrial(used ? { width_mm: CARD_MM[0], pixel_mm: CARD_MM[0] / Number(slider.value) } : { width_mm: null, pixel_mm: null });
    display.replaceChildren(
      element("div", { className: "text" }, element("h1", { textContent: "A bank card as a check" }),
        element("div", { textContent: "If you have a bank card at hand, hold it to the screen and make the shape as wide as the card (slider or arrow keys). Otherwise skip this page." })),
      drawn, slider,
      element("div", { className: "choices" },
        element("button", { textContent: "Skip", onclick: () => finish(false) }),
        element("button", { textContent: "It has the size of the card", onclick: () => finish(true) })));
    slider.focus();
  }
}

function implausible(mm) {
  if (!(mm > 0)) return "Enter the width as a number.";
  if (mm < 30 || mm > 400) return `${mm.toFixed(1)} mm cannot be right: is the unit correct?`;
  return "";
}

class AnswerPlugin {
  // One picture, or two, at a physical size, and the answers as buttons.
  static info = {
    name: "answer",
    version: "1.0.0",
    parameters: {
      question: { type: Parameter.STRING }, answers: { type: Parameter.STRING, array: true }, pictures: { type: Parameter.STRING, array: true },
      reference: { type: Parameter.STRING, default: null }, width_mm: { type: Parameter.FLOAT }, pixel_mm: { type: Parameter.FUNCTION }, progress: { type: Parameter.STRING, default: "" },
    },
    data: { answer: { type: Parameter.INT }, rt_ms: { type: Parameter.FLOAT }, shown_mm: { type: Parameter.FLOAT }, blurred: { type: Parameter.INT } },
  };
  constructor(jsPsych) { this.jsPsych = jsPsych; }

  trial(display, trial) {
    const shown = trial.pictures.map(picture);
    const reference = trial.reference ? [picture(trial.reference)] : [];
    let typed = "", blurred = 0, start = null;
    const buttons = trial.answers.map((label, number) => element("button", { textContent: label, disabled: true, onclick: () => finish(number) }));
    const choices = element("div", { className: "choices", role: "group", ariaLabel: "Answers" }, ...buttons);
    const question = element("p", { className: "question", textContent: `${trial.question} ${trial.progress}` });
    display.replaceChildren(question, ...reference.map((r) => element("div", { className: "pictures" }, r)), element("div", { className: "pictures" }, ...shown), choices);

    const blur = () => { blurred += 1; };
    const keys = (event) => {
      if (start === null || event.ctrlKey || event.altKey || event.metaKey) return;
      const focused = buttons.indexOf(document.activeElement);
      if (event.key === "ArrowRight" || event.key === "ArrowLeft") {
        const step = event.key === "ArrowRight" ? 1 : -1;
        choose((focused + step + buttons.length) % buttons.length);
      } else if (/^[0-9]$/.test(event.key)) {
        const longer = trial.answers.indexOf(typed + event.key);
        typed = longer >= 0 ? typed + event.key : event.key;
        choose(trial.answers.indexOf(typed));
      } else if (event.key === "Backspace") {
        typed = "";
      }
    };
    const choose = (number) => {
      if (number >= 0) buttons[number].focus();
      buttons.forEach((button, n) => button.classList.toggle("chosen", n === number));
    };
    const finish = (number) => {
      window.removeEventListener("blur", blur);
      document.removeEventListener("keydown", keys);
      window.removeEventListener("resize", place);
      const width = shown[0].getBoundingClientRect().width;
      this.jsPsych.finishTrial({ answer: number, rt_ms: Math.round(performance.now() - start), shown_mm: width * trial.pixel_mm(), blurred });
    };
    const place = () => {
      const [first] = shown;
      const aspect = (first.naturalHeight || first.videoHeight) / (first.naturalWidth || first.videoWidth);
      const room = window.innerHeight - question.offsetHeight - choices.offsetHeight - 40 - (reference.length ? window.innerHeight / 4 : 0);
      const most = Math.min((window.innerWidth - 16 * shown.length) / shown.length, room / aspect);
      const width = Math.min(trial.width_mm / trial.pixel_mm(), most);
      for (const own of shown) own.style.width = `${width}px`;
      for (const own of reference) own.style.height = `${window.innerHeight / 4}px`;
    };
    window.addEventListener("blur", blur);
    window.addEventListener("resize", place);
    document.addEventListener("keydown", keys);
    Promise.all([...shown, ...reference].map(ready)).then(() => {
      place();
      requestAnimationFrame(() => {
        start = performance.now();
        for (const button of buttons) button.disabled = false;
        buttons[0].focus();
      });
    });
  }
}

function picture(name) {
  const source = `stimuli/${name}`;
  return name.endsWith(".webm")
    ? element("video", { src: source, loop: true, muted: true, autoplay: true })
    : element("img", { src: source, alt: "stimulus", draggable: false });
}

function ready(shown) {
  if (shown.tagName === "IMG") return shown.decode().catch(() => new Promise((done) => { setTimeout(() => { shown.src = shown.src.split("?")[0] + `?again=${Math.random()}`; done(ready(shown)); }, 1000); }));
  return shown.readyState >= 2 ? Promise.resolve() : new Promise((done) => shown.addEventListener("loadeddata", done, { once: true }));
}
