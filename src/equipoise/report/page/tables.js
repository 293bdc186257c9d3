"use strict";
// Elements, and the blocks that are made of them. Text goes in as text alone, never as HTML.

const SVG = "http://www.w3.org/2000/svg";

function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

function drawn(tag, attributes = {}, ...children) {
  const made = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

const BESIDE = ["truth", "error", "model", "change"];  // on a telephone they stand below what was found
const LONG = 24;  // letters from which on a cell may break, also inside a word

// Verdicts are told by a sign and a word as well as by a colour.
const VERDICTS = {
  "identified": ["\u25cf", "good"], "weak": ["\u25d0", "warn"], "not identified": ["\u25cb", "poor"], "doubtful": ["\u25cb", "poor"],
  "passed": ["\u2713", "good"], "failed": ["\u2717", "poor"],
};

function verdict(word) {
  if (!word) return "";
  const [sign, tone] = VERDICTS[word] || ["", ""];
  return element("span", { class: `verdict ${tone}` }, `${sign} ${word}`);
}

// A mark: a dot for what was found, a square for the model file, a cross for the truth.
function mark(kind, x, y, size, colour = "var(--accent)") {
  if (kind === "model") {
    return drawn("rect", { x: x - size, y: y - size, width: 2 * size, height: 2 * size, fill: "var(--surface)",
      "fill-opacity": 0.6, stroke: "var(--muted)", "stroke-width": 1.8 });
  }
  if (kind === "truth") {
    const d = `M${x - size} ${y - size}L${x + size} ${y + size}M${x - size} ${y + size}L${x + size} ${y - size}`;
    return drawn("path", { d, stroke: "var(--ink)", "stroke-width": 2, fill: "none" });
  }
  return drawn("circle", { cx: x, cy: y, r: size, fill: colour, stroke: "var(--surface)", "stroke-width": 1 });
}

function barOf(bar) {
  const width = 118, middle = 10, at = (place) => place * width;
  const svg = drawn("svg", { viewBox: `0 0 ${width} 20`, role: "img", "aria-hidden": "true" });
  svg.append(drawn("line", { x1: 0, x2: width, y1: middle, y2: middle, stroke: "var(--line)" }));
  if (bar.low !== null) {
    const length = Math.max(3, at(bar.high) - at(bar.low));
    svg.append(drawn("rect", { x: at((bar.low + bar.high) / 2) - length / 2, y: middle - 4, width: length, height: 8, rx: 2,
      fill: "var(--accent)", "fill-opacity": 0.35 }));
  }
  svg.append(mark("found", at(bar.value), middle, 3));
  for (const [kind, place] of Object.entries(bar.marks)) svg.append(mark(kind, at(place), middle, kind === "model" ? 4 : 3.5));
  return svg;
}

function cellOf(cell, column, first) {
  const td = element(first ? "th" : "td", { "data-head": column.text, ...(first ? { scope: "row" } : {}) });
  if (column.number) td.classList.add("number");
  if ((cell.text || cell).length > LONG) td.classList.add("long");
  if (BESIDE.includes(column.text)) td.classList.add("beside");
  if (typeof cell === "string") {
    td.append(cell);
  } else if (cell.bar) {
    td.classList.add("bar-cell");
    td.append(barOf(cell.bar));
  } else {
    if (cell.text !== undefined) td.append(cell.text);
    if (cell.tone) td.classList.add(...cell.tone.split(" "));
    if (cell.verdict) td.append(cell.text === undefined ? "" : " ", verdict(cell.verdict));
  }
  return td;
}

function tableOf(block) {
  const heads = block.columns.map((column) =>
    element("th", { scope: "col", class: column.number ? "number" : "" }, column.text));
  const rows = block.rows.map((row) =>
    element("tr", {}, ...row.map((cell, index) => cellOf(cell, block.columns[index], index === 0))));
  const made = element("table", { class: block.kind || "", "aria-label": block.caption },
    element("thead", {}, element("tr", {}, ...heads)), element("tbody", {}, ...rows));
  const scroll = element("div", { class: "scroll" }, made);  // what it is stands outside: it does not scroll away
  if (block.folded) return element("details", {}, element("summary", {}, block.caption), scroll);
  return element("div", {}, element("p", { class: "caption" }, block.caption), scroll);
}

function barKey(block) {
  const bars = block.rows.map((row) => row.find((cell) => cell.bar)).filter(Boolean).map((cell) => cell.bar);
  if (!bars.length) return "";
  const key = element("p", { class: "key" });
  const add = (kind, words) => {
    const svg = drawn("svg", { viewBox: "0 0 16 12" });
    if (kind === "interval") svg.append(drawn("rect", { x: 0, y: 2, width: 16, height: 8, rx: 2, fill: "var(--accent)", "fill-opacity": 0.35 }));
    else svg.append(mark(kind, 8, 6, kind === "found" ? 3 : 4));
    key.append(element("span", {}, svg, words));
  };
  if (bars.some((bar) => bar.low !== null)) add("interval", "95 % interval");
  add("found", "found");
  add("model", "model file");
  if (bars.some((bar) => bar.marks.truth !== undefined)) add("truth", "truth (simulation)");
  if (bars.some((bar) => bar.low !== null)) key.append(element("span", {}, "bold change: the model file's value is outside the interval"));
  return key;
}
