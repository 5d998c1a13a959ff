// Plots over time and the map of the zero moment point, as SVG.
"use strict";

const SVG = "http://www.w3.org/2000/svg", WIDE = 320, HIGH = 150;
const BOX = { left: 46, right: 312, top: 34, bottom: 128 };

function drawn(parent, name, attributes, text) {
  const element = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  parent.appendChild(element);
  return element;
}

// Path through points; a null breaks it.
function pathOf(points) {
  let broken = true, path = "";
  for (const point of points) {
    if (point === null) { broken = true; continue; }
    path += `${broken ? "M" : "L"}${point[0].toFixed(2)} ${point[1].toFixed(2)}`;
    broken = false;
  }
  return path;
}

// Range that a chart shows: its values, and the bounds that are not far away.
function rangeOf(chart, extra) {
  const values = chart.values.filter((value) => value !== null);
  let low = Math.min(...values, 0), high = Math.max(...values, 0);
  if (!values.length) return [0, 1];
  const size = Math.max(high - low, 1e-9);
  for (const bound of [chart.lower, chart.upper, ...extra]) {
    if (bound === null || bound === undefined) continue;
    if (chart.group === "constraint" || Math.abs(bound) < 4 * size) { low = Math.min(low, bound); high = Math.max(high, bound); }
  }
  const border = 0.06 * (high - low || 1);
  return [low - border, high + border];
}

// One curve over time with its bounds; returns a function that moves its cursor.
function drawChart(parent, chart, times, span, range, asked, seek, guaranteed) {
  const svg = drawn(parent, "svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, role: "img", "data-chart": `${chart.group}:${chart.title}` });
  const x = (t) => BOX.left + (BOX.right - BOX.left) * t / (span || 1);
  const y = (value) => BOX.bottom - (BOX.bottom - BOX.top) * (value - range[0]) / (range[1] - range[0]);
  drawn(svg, "title", {}, `${chart.title}, ${chart.group}, over time`);
  const name = chart.group === "constraint" ? chart.title.replaceAll("_", " ") : `${chart.title}: ${chart.group}`;
  drawn(svg, "text", { x: 6, y: 14, class: "title" }, `${name} [${chart.unit}]`);
  for (const tick of ticks(range[0], range[1], 4)) {
    drawn(svg, "path", { class: "grid", d: `M${BOX.left} ${y(tick)}H${BOX.right}` });
    drawn(svg, "text", { x: BOX.left - 4, y: y(tick) + 4, "text-anchor": "end", class: "soft" }, brief(tick));
  }
  for (const tick of ticks(0, span, 5)) drawn(svg, "text", { x: x(tick), y: HIGH - 8, "text-anchor": "middle", class: "soft" }, `${brief(tick)} s`);
  const level = (value, kind) => value !== null && value !== undefined && value >= range[0] && value <= range[1]
    && drawn(svg, "path", { class: kind, d: `M${BOX.left} ${y(value)}H${BOX.right}` });
  const points = chart.values.map((value, i) => value === null ? null : [x(times[i]), y(value)]);
  drawn(svg, "path", { class: "curve", d: pathOf(points) });
  const beyond = (value) => value !== null && (chart.lower !== null && value < Math.max(chart.lower, asked ?? -Infinity) - tolerance(chart)
    || chart.upper !== null && value > chart.upper + tolerance(chart));
  const over = points.map((point, i) => beyond(chart.values[i]) ? point : null);
  if (over.some((point) => point)) drawn(svg, "path", { class: "curve over", d: pathOf(over) });
  level(chart.lower, "bound"); level(chart.upper, "bound");
  if (asked) level(asked, "asked");
  if (guaranteed && level(guaranteed.value, "guaranteed")) {
    const words = `${guaranteed.proven ? "guaranteed" : "sampled"}: ${inWords(guaranteed.value, guaranteed.unit)}`;
    const line = y(guaranteed.value), base = BOX.bottom - line < 15 ? line - 4 : line + 12, wide = 5.6 * words.length;
    const start = clearest([BOX.left + 2, (BOX.left + BOX.right - wide) / 2, BOX.right - wide - 2], wide, base - 4, points);
    drawn(svg, "text", { x: start.toFixed(1), y: base.toFixed(1), class: "guaranteedwords" }, words);
  }
  drawn(svg, "text", { x: 6, y: 28, class: "soft" }, boundsInWords(chart, asked));
  const cursor = drawn(svg, "path", { class: "cursor", d: "" }), dot = drawn(svg, "circle", { class: "dot", r: 3.5 });
  const now = drawn(svg, "text", { x: WIDE - 6, y: 28, "text-anchor": "end" }, "");
  dragging(svg, (share) => seek(span * (share * WIDE - BOX.left) / (BOX.right - BOX.left)));
  return (at, t) => {
    const value = valueAt(chart.values, at);
    cursor.setAttribute("d", `M${x(t).toFixed(2)} ${BOX.top}V${BOX.bottom}`);
    dot.setAttribute("visibility", value === null ? "hidden" : "visible");
    if (value !== null) { dot.setAttribute("cx", x(t).toFixed(2)); dot.setAttribute("cy", y(value).toFixed(2)); }
    const row = chart.rows && chart.row[at.w < 1 ? at.i : at.i + 1], unit = chart.units ? chart.units[row] : chart.unit;
    now.textContent = inWords(value, unit) + (chart.rows && chart.rows.length > 1 ? `, ${chart.rows[row]}` : "");
  };
}

// Of some places for a text, the one from which a curve keeps farthest.
function clearest(starts, wide, middle, points) {
  const room = (start) => Math.min(...points.filter((point) => point && point[0] >= start && point[0] <= start + wide).map((point) => Math.abs(point[1] - middle)), 1e9);
  return starts.reduce((best, start) => room(start) > room(best) ? start : best);
}

function boundsInWords(chart, asked) {
  if (chart.group === "constraint") return asked ? `asked for: ${inWords(asked, chart.unit)}` : "at least 0";
  if (chart.lower === null && chart.upper === null) return "no limit";
  if (chart.lower !== null && chart.lower === -chart.upper) return `within \u00b1${brief(chart.upper)}`;
  return `within ${chart.lower === null ? "-\u221e" : brief(chart.lower)} to ${chart.upper === null ? "\u221e" : brief(chart.upper)}`;
}

// What rounding of the data may exceed a bound by.
function tolerance(chart) { return chart.group === "constraint" ? 1e-4 * (chart.unit === "m" ? 1 : 10) : 2e-4; }

function brief(value) {
  if (Math.abs(value) >= 1e4) return `${Number((value / 1000).toPrecision(3))}k`;
  return String(Number(value.toPrecision(3)));
}

// Calls back with the share of the width, while the pointer is down.
function dragging(svg, call) {
  const move = (event) => { const box = svg.getBoundingClientRect(); call((event.clientX - box.left) / box.width); };
  svg.addEventListener("pointerdown", (event) => { svg.setPointerCapture(event.pointerId); move(event); });
  svg.addEventListener("pointermove", (event) => { if (event.buttons) move(event); });
}

// The zero moment point in the support polygon, seen from above: x to the right, y up.
function drawMap(parent, record, full) {
  const size = 320, support = record.support.vertices, motion = record.plan, blind = record.blind;
  const every = [...support, ...motion.zmp.filter(Boolean)];
  const bounds = [0, 1].map((axis) => every.map((point) => point[axis]))
    .map((entries) => [Math.min(...entries), Math.max(...entries)]);
  const polygon = [0, 1].map((axis) => support.map((point) => point[axis])).map((entries) => Math.max(...entries) - Math.min(...entries));
  const middle = bounds.map(([low, high]) => (low + high) / 2);
  const reach = Math.min(Math.max(...bounds.map(([low, high]) => high - low)), 3 * Math.max(...polygon)) * 0.62;
  const x = (value) => size / 2 + (value - middle[0]) / reach * (size / 2 - 26) + 8;
  const y = (value) => size / 2 - (value - middle[1]) / reach * (size / 2 - 26) - 4;
  const place = (point) => point && [x(point[0]), y(point[1])];
  const svg = drawn(parent, "svg", { viewBox: `0 0 ${size} ${size}`, role: "img", class: "top" });
  drawn(svg, "title", {}, "Zero moment point in the support polygon, from above");
  drawn(svg, "text", { x: 6, y: 14, class: "title" }, "Zero moment point, from above");
  for (const tick of ticks(middle[0] - reach, middle[0] + reach, 5)) drawn(svg, "text", { x: x(tick), y: size - 20, "text-anchor": "middle", class: "soft" }, brief(tick));
  for (const tick of ticks(middle[1] - reach, middle[1] + reach, 5)) drawn(svg, "text", { x: 4, y: y(tick) + 4, class: "soft" }, brief(tick));
  drawn(svg, "text", { x: size - 6, y: size - 6, "text-anchor": "end", class: "soft" }, "x forward, y left [m]");
  drawn(svg, "path", { class: "polygon", d: `${pathOf(support.map(place))}Z` });
  if (blind) drawn(svg, "path", { class: "blind", d: pathOf(blind.zmp.map(place)) });
  for (const { kind, points } of pieces(motion, record.margin_asked, full))
    drawn(svg, "path", { class: `trail ${kind}`, d: pathOf(points.map(place)) });
  const other = blind && drawn(svg, "circle", { class: "blindzmp", r: 5 });
  const marker = drawn(svg, "circle", { class: "zmp", r: 6, "data-marker": "zmp" });
  return (point, blindPoint, bad) => {
    marker.setAttribute("class", bad ? "zmp outside" : "zmp");
    for (const [circle, at] of [[marker, point], [other, blindPoint]]) {
      if (!circle) continue;
      circle.setAttribute("visibility", at ? "visible" : "hidden");
      if (at) { circle.setAttribute("cx", x(at[0]).toFixed(2)); circle.setAttribute("cy", y(at[1]).toFixed(2)); }
    }
    marker.dataset.x = point ? point[0] : ""; marker.dataset.y = point ? point[1] : "";
  };
}

// Stretches of a trail with one class of margin each.
function pieces(motion, asked, full) {
  const found = [];
  for (let i = 0; i + 1 < motion.zmp.length; i++) {
    const least = [motion.margin[i], motion.margin[i + 1]], kind = grade(least.includes(null) ? null : Math.min(...least), asked, full);
    const last = found[found.length - 1];
    if (last && last.kind === kind) last.points.push(motion.zmp[i + 1]);
    else found.push({ kind, first: i, points: [motion.zmp[i], motion.zmp[i + 1]] });
  }
  return found;
}
