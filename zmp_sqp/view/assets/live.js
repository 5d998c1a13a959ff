// Asks the planner for what the sliders say, and shows its newest answer. What is shown for other settings is marked as stale.
"use strict";

(() => {
  const live = JSON.parse(document.getElementById("live").textContent), article = document.querySelector("[data-plan='0']");
  const within = (selector) => article.querySelector(selector);
  const side = within(".panel"), SETTLE = 250, RETRY = 2000; // [ms]
  // number of the newest change, request under way, time at which the change was made
  let newest = 0, flight = null, moved = performance.now(), timer = 0, mode = live.moves ? "motion" : "rest", share, tables = true;

  const modes = made(side, "div", { class: "modes" });
  const switches = Object.fromEntries([["motion", "Motion"], ["rest", "Pose at rest"]].map(([name, title]) => {
    const button = made(modes, "button", { type: "button", "data-mode": name }, title);
    button.addEventListener("click", () => choose(name));
    return [name, button];
  }));
  const panel = new Panel(side, live.controls, (key, group) => {
    if (group !== "pose") tables = true;
    change({ goal: 1, base: 1, start: 0 }[group]);
  });
  poseButtons(panel.groups.pose.box);
  const buttons = made(side, "div", { class: "buttons" });
  const said = document.createElement("p");
  if (live.saves) button(buttons, `Save to ${live.saves.split(/[\\/]/).pop()}`, "save-file", saveFile);
  button(buttons, live.saves ? "Download scenario" : "Save scenario", "save-scenario", download);
  button(buttons, "Reset", "reset", () => { panel.reset(); tables = true; change(); });
  said.className = "said";
  said.setAttribute("role", "status");
  side.appendChild(said);

  function button(parent, title, id, work) {
    const made_ = made(parent, "button", { type: "button", id }, title);
    made_.addEventListener("click", work);
    return made_;
  }

  // Named poses to click, and the pose of the sliders as start or goal of the motion.
  function poseButtons(box) {
    const named = made(box, "div", { class: "buttons", "aria-label": "Named poses" });
    for (const [name, pose] of Object.entries(live.poses)) {
      const choice = made(named, "button", { type: "button", "data-pose": name }, name);
      choice.addEventListener("click", () => { for (const [key, value] of Object.entries(pose)) panel.set(key, value); });
    }
    const take = made(box, "div", { class: "buttons" });
    for (const end of ["start", "goal"]) {
      const choice = made(take, "button", { type: "button", "data-take": end }, `Take as ${end}`);
      choice.addEventListener("click", () => {
        for (const { control } of [...panel.rows.values()]) if (control.group === "pose") panel.set(`${end}.${control.label}`, panel.valueOf(control.key));
        said.textContent = `The motion's ${end} is this pose.`;
      });
    }
  }

  function choose(name) {
    mode = name;
    share = undefined;
    tables = true;
    for (const [key, choice] of Object.entries(switches)) choice.setAttribute("aria-pressed", String(key === mode));
    panel.choose(mode);
    within(".inspection").hidden = mode !== "rest";
    for (const part of [".constraints", ".joints", ".guarantees", ".rests-on"]) within(part).hidden = mode === "rest";
    change();
  }

  // Something has changed: what is shown is stale from now on.
  function change(at) {
    if (at !== undefined) share = at;
    newest += 1;
    moved = performance.now();
    stale(true);
    clearTimeout(timer);
    if (flight && flight.settle) { flight.abort.abort(); flight = null; }
    if (!flight) ask(false);
  }

  function stale(on) {
    article.setAttribute("aria-busy", String(on)); // what is read out waits for the newest answer
    article.classList.toggle("stale", on);
    within(".badge").hidden = !on;
  }

  async function post(path, content, signal) {
    const reply = await fetch(path, { method: "POST", signal, body: JSON.stringify(content),
      headers: { "Content-Type": "application/json", "X-Zmp-Sqp-Token": live.token } });
    const answer = await reply.json();
    if (!reply.ok) throw new Error(answer.error);
    return answer;
  }

  async function ask(settle) {
    const asked = newest, at = moved, resting = mode === "rest", mine = { settle, abort: new AbortController() };
    flight = mine;
    let answer = null, fault = null;
    try {
      answer = await post(resting ? "/rest" : "/plan", { values: panel.values, ...(resting ? { tables } : { settle }) }, mine.abort.signal);
    } catch (error) { fault = error; }
    if (flight !== mine) return; // a newer request took its place
    flight = null;
    if (fault) return failed(fault);
    if (answer.state === "superseded") { timer = setTimeout(() => { if (!flight) ask(settle); }, SETTLE); return; }
    if (resting === (mode === "rest")) show(answer, asked, at, settle);
    if (asked !== newest) ask(false);
    else if (!answer.settled) timer = setTimeout(() => { if (!flight && asked === newest) ask(true); }, answer.state === "searching" ? 0 : SETTLE);
  }

  // What would do in place of a motion that is not safe.
  async function advise() {
    const asked = newest, mine = { settle: true, abort: new AbortController() };
    clearTimeout(timer);
    flight = mine;
    within(".advice").textContent = "Looking for a lighter payload or a gentler slope ...";
    let words;
    try { const answer = await post("/advice", { values: panel.values }, mine.abort.signal); words = answer.words || ""; }
    catch (fault) { words = ""; if (flight === mine) within(".times").textContent = `No advice: ${fault.message}`; }
    if (flight !== mine) return;
    flight = null;
    if (asked === newest) within(".advice").innerHTML = words;
  }

  function failed(fault) {
    const lost = fault instanceof TypeError;
    stale(true);
    article.dataset.state = "lost";
    within(".advice").replaceChildren();
    within(".times").textContent = lost ? "zmp-sqp does not answer: has it been stopped? What is shown is stale." : fault.message;
    if (lost) timer = setTimeout(() => { if (!flight) ask(false); }, RETRY);
  }

  function show(answer, asked, at, settle) {
    const fresh = asked === newest, { record } = answer, searching = answer.state === "searching";
    const kind = { safe: "safe", unsafe: "unsafe", refused: "refused", tips: "tips" }[answer.state] || "rest";
    article.dataset.state = answer.state;
    within(".verdict").className = `verdict ${kind}`;
    within(".words").innerHTML = answer.verdict;
    within(".advice").replaceChildren();
    if (answer.state === "unsafe" && fresh) button(within(".advice"), "What would do?", "advise", advise);
    within(".warnings").replaceChildren(...answer.warnings.map((text) => { const item = document.createElement("li"); item.textContent = text; return item; }));
    for (const [part, html] of [[".guarantees", answer.guarantees_table], [".rests-on", answer.rests_on_table], [".inspection", answer.inspection]])
      if (html !== undefined) within(`${part} > div`).innerHTML = html;
      else if (part !== ".inspection") within(`${part} > div`).replaceChildren();
    if (answer.inspection !== undefined && fresh) tables = false;
    if (record) {
      record.parts = [...live.parts, ...record.payloads];
      zmpReport.replace(0, { scenario: live.name, guarantees: answer.guarantees || [], record }, settle ? undefined : share);
      if (fresh && !searching) share = undefined;
    }
    within(".stage").hidden = !record && !searching;
    if (within(".stage").hidden) document.querySelector(".transport").hidden = true;
    for (const part of [".constraints", ".joints"]) within(part).hidden = mode === "rest" || !record || !record.plan.charts.length;
    for (const part of [".guarantees", ".rests-on"]) within(part).hidden = mode === "rest" || !within(`${part} > div`).firstChild;
    stale(!fresh || searching);
    requestAnimationFrame(() => {
      const all = Math.round(performance.now() - at), { plan } = answer.milliseconds;
      const what = mode === "rest" ? "Computed" : answer.state === "refused" ? "Checked" : "Planned";
      if (!settle) within(".times").dataset.screen = all;
      within(".times").textContent = `${what} in ${plan} ms${settle ? "; this is what zmp-sqp plan gives" : `, on screen ${all} ms after the change`}.`;
      article.dataset.shown = asked;
      article.dataset.settled = String(answer.settled);
    });
  }

  async function saveFile() {
    try { said.textContent = `Saved to ${(await post("/save", { values: panel.values })).saved}.`; }
    catch (fault) { said.textContent = `Not saved: ${fault.message}`; }
  }

  async function download() {
    try {
      const { text } = await post("/text", { values: panel.values }), link = document.createElement("a");
      link.href = URL.createObjectURL(new Blob([text], { type: "application/toml" }));
      link.download = `${live.name}.toml`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1000);
      said.textContent = `Saved as ${link.download}.`;
    } catch (fault) { said.textContent = `Not saved: ${fault.message}`; }
  }

  window.zmpView = { panel, values: () => panel.values, newest: () => newest };
  choose(mode);
})();
