// Sliders of the live view, each with a box for the exact number.
"use strict";

const GROUPS = [
  ["missing", "Limits that are missing", ["motion"], true],
  ["goal", "Goal", ["motion"], true], ["pose", "Pose at rest", ["rest"], true], ["ground", "Slope", ["motion", "rest"], true],
  ["load", "Payload and margin", ["motion", "rest"], true], ["limits", "Limits, in % of the machine's", ["motion"], true],
  ["base", "Goal of the base", ["motion"], true], ["start", "Start", ["motion"], false],
];

function made(parent, name, attributes, text) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  parent.appendChild(element);
  return element;
}

// Rows of controls in groups; `changed(key, group)` is called when one of them is moved.
class Panel {
  constructor(parent, controls, changed) {
    this.rows = new Map();
    this.groups = {};
    this.values = {}; // of the controls that were moved
    this.changed = changed;
    for (const [group, title, modes, open] of GROUPS) {
      const members = controls.filter((control) => control.group === group);
      if (!members.length) continue;
      const box = open ? made(parent, "fieldset", {}) : made(parent, "details", {});
      made(box, open ? "legend" : "summary", {}, title);
      this.groups[group] = { box, modes };
      for (const control of members) this.addRow(box, control);
    }
  }

  addRow(parent, control) {
    const row = made(parent, "div", { class: "row" }), id = `control-${this.rows.size}`, { low, high, step } = control;
    made(row, "label", { for: id }, control.label);
    const value = made(row, "span", { class: "value" });
    const box = made(value, "input", { type: "number", id, step: "any", "data-box": control.key });
    made(value, "span", { class: "unit" }, control.unit === "deg" ? "\u00b0" : control.unit);
    // stops at whole steps, and at the ends of the range
    const least = Math.ceil(low / step - 1e-6) * step, most = Math.floor(high / step + 1e-6) * step;
    const slider = made(row, "input", { type: "range", min: tidy(least), max: tidy(most), step, "data-control": control.key,
      "aria-label": `${control.label}, ${control.group}` });
    this.rows.set(control.key, { control, slider, box });
    slider.disabled = box.disabled = high - low < 1e-6;
    if (slider.disabled) row.title = "its limits hold it there";
    slider.addEventListener("input", () => this.set(control.key, Number(slider.value), slider));
    box.addEventListener("input", () => {
      const number = box.value.trim() === "" ? NaN : Number(box.value), valid = number >= low - 1e-6 && number <= high + 1e-6;
      box.setAttribute("aria-invalid", String(!valid));
      if (valid) this.set(control.key, number, box);
    });
    box.addEventListener("change", () => this.show(control.key));
    this.show(control.key);
  }

  valueOf(key) { return this.values[key] ?? this.rows.get(key).control.value; }

  // Set a value; `from` is the element that has it already.
  set(key, value, from) {
    const { control } = this.rows.get(key);
    this.values[key] = Math.min(Math.max(value, control.low), control.high);
    this.show(key, from);
    this.changed(key, control.group);
  }

  show(key, from) {
    const { control, slider, box } = this.rows.get(key), value = this.valueOf(key);
    const unit = control.unit === "deg" ? "degrees" : control.unit;
    if (slider !== from) slider.value = value;
    slider.setAttribute("aria-valuetext", `${tidy(value)} ${unit}`);
    if (box !== from) { box.value = tidy(value); box.setAttribute("aria-invalid", "false"); }
  }

  reset() {
    this.values = {};
    for (const key of this.rows.keys()) this.show(key);
  }

  // Show the groups of a mode: motion or rest.
  choose(mode) { for (const { box, modes } of Object.values(this.groups)) box.hidden = !modes.includes(mode); }
}

function tidy(value) { return String(Number(value.toFixed(4))); }
