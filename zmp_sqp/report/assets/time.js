// Values of samples at any time, and numbers in words. Pure functions; tests run them without a page.
"use strict";

// Last sample not after t, and how far t is towards the next one (0 to 1).
function locate(times, t) {
  const last = times.length - 2;
  if (last < 0 || t <= times[0] && times[0] < (times[1] ?? Infinity)) return { i: 0, w: 0 };
  if (t >= times[times.length - 1]) return { i: last, w: 1 };
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle; else high = middle;
  }
  const step = times[low + 1] - times[low];
  return { i: low, w: step > 0 ? (t - times[low]) / step : 0 };
}

function between(a, b, w) { return a === null || b === null || b === undefined ? (w < 1 ? a : b ?? a) : a + w * (b - a); }

// Value at a place that `locate` found; null where there is none.
function valueAt(values, at) { return between(values[at.i], values[at.i + 1], at.w); }

// Point at a place; null where either neighbour has none.
function pointAt(points, at) {
  const a = points[at.i], b = points[Math.min(at.i + 1, points.length - 1)];
  if (!a || !b) return (at.w < 1 ? a : b) || null;
  return a.map((entry, i) => entry + at.w * (b[i] - entry));
}

// Two poses (position, quaternion) about the place, and the share between them.
function posesAt(poses, at) {
  if (poses.length === 1) return [poses[0], poses[0], 0];
  return [poses[at.i], poses[at.i + 1] ?? poses[at.i], at.w];
}

// Class of a margin: outside the polygon, less than asked for, near it, or room for more.
function grade(margin, asked, full) {
  if (margin === null || margin < 0) return "out";
  if (margin < asked - 1e-6) return "short";
  return margin < asked + 0.2 * Math.max(full - asked, 0) ? "tight" : "ample";
}

// Round numbers that divide a range into a few parts.
function ticks(low, high, count) {
  if (!(high > low)) return [low];
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= raw * 0.999);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
  return found;
}

function inWords(value, unit) {
  if (value === null || value === undefined) return "none";
  if (unit === "m" && Math.abs(value) < 0.1) return `${trimmed(1000 * value)} mm`;
  if (/^N/.test(unit) && Math.abs(value) >= 1e4) return `${trimmed(value / 1000)} k${unit}`;
  return `${trimmed(value)} ${unit}`.trim();
}

function trimmed(value) { return value === 0 ? "0" : String(Number(value.toPrecision(3))); }

if (typeof module !== "undefined") module.exports = { locate, valueAt, pointAt, posesAt, grade, ticks, inWords };
