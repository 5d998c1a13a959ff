// Ties the time cursor to the views and the plots.
"use strict";

(() => {
  const plans = JSON.parse(document.getElementById("data").textContent);
  const byId = (name) => document.getElementById(name);
  const slider = byId("time"), clock = byId("clock"), play = byId("play"), speed = byId("speed"), camera = byId("camera"), ghost = byId("ghost");
  const views = new Map(); // 3-D view of each article: it outlives the plan that it shows
  let shown = [], span = 1e-9, ranges = {}, panels = [], time = 0, playing = false, before = 0;

  function lay() {
    shown = plans.map((plan, i) => ({ plan, element: document.querySelector(`[data-plan="${i}"]`) })).filter(({ plan }) => plan.record);
    span = Math.max(1e-9, ...shown.map(({ plan }) => plan.record.plan.duration));
    ranges = sharedRanges();
    panels = shown.map(panelOf);
    slider.max = span;
    ghost.parentElement.hidden = !shown.some(({ plan }) => plan.record.blind);
    document.querySelector(".transport").hidden = !shown.some(({ plan }) => plan.record.plan.times.length > 1);
  }

  // Show another plan in an article; the time cursor stays at its share of the motion, or goes to `share` of it.
  function replace(number, plan, share) {
    const before = share ?? time / span;
    plans[number] = plan;
    lay();
    seek(before * span);
  }

  function askedOf(plan, chart) {
    return chart.group === "constraint" ? plan.guarantees.find((found) => found.name === chart.title)?.required || null : null;
  }

  function guaranteedOf(plan, chart) {
    const found = chart.group === "constraint" && plan.guarantees.find((one) => one.name === chart.title && one.unit === chart.unit);
    return found && found.value !== null ? found : null;
  }

  // Charts of the same name have one range in all plans.
  function sharedRanges() {
    const found = {};
    for (const { plan } of shown) for (const chart of plan.record.plan.charts) {
      const key = `${chart.group}:${chart.title}`, [low, high] = rangeOf(chart, [askedOf(plan, chart), guaranteedOf(plan, chart)?.value]);
      found[key] = key in found ? [Math.min(low, found[key][0]), Math.max(high, found[key][1])] : [low, high];
    }
    return found;
  }

  function panelOf({ plan, element }) {
    const { record } = plan, motion = record.plan, full = Math.max(0, ...motion.margin.filter((entry) => entry !== null));
    let view = views.get(element) || null;
    if (view) view.update(record, full);
    else if (!views.has(element)) try { view = new View(element.querySelector(".canvas"), record, full); } catch (error) {
      const note = document.createElement("p");
      note.className = "note";
      note.textContent = `This browser has no WebGL, so the machine is not drawn (${error.message}); the plots are complete.`;
      element.querySelector(".canvas").replaceChildren(note);
    }
    views.set(element, view);
    for (const place of element.querySelectorAll(".map, .constraints > div, .joints > div")) place.replaceChildren();
    const map = record.support ? drawMap(element.querySelector(".map"), record, full) : () => {};
    const cursors = motion.charts.map((chart) => drawChart(
      element.querySelector(chart.group === "constraint" ? ".constraints > div" : ".joints > div"),
      chart, motion.times, span, ranges[`${chart.group}:${chart.title}`], askedOf(plan, chart), seek, guaranteedOf(plan, chart)));
    const now = element.querySelector(".now");
    return { view, show: (t) => {
      const at = locate(motion.times, t), point = pointAt(motion.zmp, at), margin = valueAt(motion.margin, at);
      const blind = record.blind && locate(record.blind.times, t), blindMargin = blind && valueAt(record.blind.margin, blind);
      if (view) { view.move(view.plan, t); if (view.blind) view.move(view.blind, t); view.render(); }
      const bad = margin === null || margin < 0;
      map(point, blind && ghost.checked ? pointAt(record.blind.zmp, blind) : null, bad);
      for (const cursor of cursors) cursor(at, Math.min(t, motion.duration));
      now.classList.toggle("bad", bad);
      now.textContent = `${bad ? "\u2717 outside, tips over: " : ""}margin ${inWords(margin, "m")}`
        + (blind ? `; stability-blind: ${blindWords(record.blind, blindMargin, t)}` : "");
    } };
  }

  function blindWords(motion, margin, t) {
    const { fall } = motion;
    if (fall && fall.over && t >= fall.times[fall.times.length - 1]) return "\u2717 fallen over (simulated)";
    return margin === null ? "\u2717 lifts off" : `${margin < 0 ? "\u2717 " : ""}${inWords(margin, "m")}`;
  }

  function seek(t) {
    time = Math.min(Math.max(t, 0), span);
    slider.value = time;
    clock.value = `${time.toFixed(3)} s`;
    slider.setAttribute("aria-valuetext", clock.value);
    for (const panel of panels) panel.show(time);
  }

  function toggle(on) {
    playing = on;
    play.textContent = on ? "Pause" : "Play";
    play.setAttribute("aria-pressed", String(on));
    if (on && time >= span) seek(0);
    if (on) { before = performance.now(); requestAnimationFrame(frame); }
  }

  function frame(now) {
    if (!playing) return;
    seek(time + Number(speed.value) * Math.max(0, now - before) / 1000);
    before = now;
    if (time >= span) toggle(false); else requestAnimationFrame(frame);
  }

  function keys(event) {
    const target = event.target, typing = target.matches("select, input[type=range]"), far = event.shiftKey ? 10 : 1;
    if (event.ctrlKey || event.metaKey || event.altKey || target.matches("select") || target.closest("[data-own-keys]")) return;
    const step = far * span / 200, known = {
      " ": () => toggle(!playing), ArrowRight: () => seek(time + step), ArrowLeft: () => seek(time - step),
      Home: () => seek(0), End: () => seek(span), g: () => ghost.click(), G: () => ghost.click(),
    };
    [...camera.options].forEach((option, i) => { known[String(i + 1)] = () => { camera.value = option.value; look(); }; });
    if (event.key === " " && target.matches("button, summary, input[type=checkbox]")) return;
    if (typing && event.key === " " || known[event.key]) { event.preventDefault(); known[event.key]?.(); }
  }

  function look() { for (const { view } of panels) view?.preset(camera.value); }

  function darken(on) {
    document.documentElement.classList.toggle("dark", on);
    byId("dark").setAttribute("aria-pressed", String(on));
    for (const { view } of panels) view?.render();
  }

  function save() {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([JSON.stringify(plans.length === 1 ? plans[0] : plans, null, 1)], { type: "application/json" }));
    link.download = plans.length === 1 ? `${plans[0].scenario}.plan.json` : "plans.json";
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }

  function printing(on) {
    for (const { view } of panels) if (view) { view.printing = on; view.render(); }
    if (on) for (const details of document.querySelectorAll("details")) details.open = true;
  }

  slider.addEventListener("input", () => { toggle(false); seek(Number(slider.value)); });
  play.addEventListener("click", () => toggle(!playing));
  camera.addEventListener("change", look);
  ghost.addEventListener("change", () => { for (const { view } of panels) view?.show(ghost.checked); look(); seek(time); });
  byId("dark").addEventListener("click", () => darken(!document.documentElement.classList.contains("dark")));
  byId("save")?.addEventListener("click", save);
  document.addEventListener("keydown", keys);
  window.addEventListener("beforeprint", () => printing(true));
  window.addEventListener("afterprint", () => printing(false));
  lay();
  if (window.matchMedia("(prefers-color-scheme: dark)").matches) darken(true);
  window.zmpReport = { seek, replace, playing: () => playing, time: () => time, get views() { return panels.map(({ view }) => view); }, get span() { return span; } };
  seek(0);
})();
