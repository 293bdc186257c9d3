"use strict";
// The plan view: the robot with its support lines, and beside it the millimetres around the centre of mass.

const DIAGONAL_COLOURS = { FL_RR: "var(--series-3)", FR_RL: "var(--series-4)" };
const DIAGONAL_DASHES = { FL_RR: "none", FR_RL: "7 4" };
const RUN_COLOURS = ["var(--series-1)", "var(--series-2)", "var(--series-3)", "var(--series-4)"];

function colourOf(view, mark) {
  const found = view.marks.filter((other) => other.kind === "found");
  return RUN_COLOURS[found.indexOf(mark) % RUN_COLOURS.length];
}

// Forward (x) is up, left (y) is left.
function panel(width, height, centre, scale) {
  const svg = drawn("svg", { viewBox: `0 0 ${width} ${height}`, role: "img" });
  const at = ([x, y]) => [width / 2 - (y - centre[1]) * scale, height / 2 - (x - centre[0]) * scale];
  return { svg, at, scale, width, height };
}

function polygon(view, points, attributes) {
  return drawn("polygon", { points: points.map((point) => view.at(point).map((v) => v.toFixed(1)).join(",")).join(" "), ...attributes });
}

function lineIn(view, line, attributes) {
  const reach = 2 * Math.hypot(view.width, view.height) / view.scale, centre = view.centre || line.at;
  const along = (centre[0] - line.at[0]) * line.along[0] + (centre[1] - line.at[1]) * line.along[1];
  const near = [line.at[0] + along * line.along[0], line.at[1] + along * line.along[1]];
  const [a, b] = [-1, 1].map((sign) => view.at([near[0] + sign * reach * line.along[0], near[1] + sign * reach * line.along[1]]));
  return drawn("line", { x1: a[0], y1: a[1], x2: b[0], y2: b[1], stroke: DIAGONAL_COLOURS[line.diagonal],
    "stroke-dasharray": DIAGONAL_DASHES[line.diagonal], ...attributes });
}

function words(x, y, text, attributes = {}) {
  return drawn("text", { x, y, ...attributes }, text);
}

function overview(data) {
  const points = [...data.feet.map((foot) => foot.at), ...data.outline, ...data.legs.flat()];
  const far = [0, 1].map((axis) => Math.max(...points.map((point) => Math.abs(point[axis]))) * 1.12);
  const width = 220, height = 340, view = panel(width, height, [0, 0], Math.min((width / 2 - 8) / far[1], (height / 2 - 24) / far[0]));
  const { svg, at, scale } = view;
  for (const leg of data.legs) svg.append(polygon(view, leg, { fill: "var(--robot)", "fill-opacity": 0.3 }));
  svg.append(polygon(view, data.outline, { fill: "var(--raised)", stroke: "var(--robot)", "stroke-width": 1 }));
  for (const line of data.lines) svg.append(lineIn(view, line, { "stroke-width": line.feet ? 1.2 : 2 }));
  for (const foot of data.feet) {
    const [x, y] = at(foot.at), r = Math.max(4, foot.radius * scale);
    svg.append(drawn("circle", { cx: x, cy: y, r, fill: "var(--surface)", stroke: "var(--ink)", "stroke-width": 1.4 }));
    svg.append(words(x + (x < width / 2 ? -1 : 1) * (r + 4), y + 4, foot.name,
      { class: "foot-name", "text-anchor": x < width / 2 ? "end" : "start" }));
  }
  for (const one of data.marks.filter((other) => other.kind === "found")) svg.append(mark("found", ...at(one.at), 3.5, colourOf(data, one)));
  const [left, top] = at([data.zoom.centre[0] + data.zoom.half, data.zoom.centre[1] + data.zoom.half]);
  const side = 2 * data.zoom.half * scale;
  svg.append(drawn("rect", { x: left, y: top, width: side, height: side, fill: "none", stroke: "var(--ink)", "stroke-width": 1 }));
  svg.append(words(width / 2, 12, "\u25b2 front", { "text-anchor": "middle" }));
  const bar = [500, 200, 100, 50, 20].find((length) => length * scale < width / 2) || 10;
  svg.append(drawn("path", { d: `M8 ${height - 14}v6h${bar * scale}v-6`, stroke: "var(--muted)", fill: "none" }));
  svg.append(words(8, height - 18, `${bar} mm`));
  return svg;
}

function closeUp(data) {
  const size = 340, edge = 34, inner = size - edge, half = data.zoom.half;
  const view = panel(size, size, data.zoom.centre, (inner - 6) / (2 * half));
  view.at = ([x, y]) => [edge + inner / 2 - (y - data.zoom.centre[1]) * view.scale, inner / 2 - (x - data.zoom.centre[0]) * view.scale];
  view.centre = data.zoom.centre;
  const { svg, at } = view;
  const clip = "close-up";
  svg.append(drawn("clipPath", { id: clip }, drawn("rect", { x: edge, y: 0, width: inner, height: inner })));
  const inside = drawn("g", { "clip-path": `url(#${clip})` });
  const step = [0.5, 1, 2, 5, 10, 20, 50, 100].find((length) => 2 * half / length <= 8) || 100;
  for (const axis of [0, 1]) {
    const [low, high] = [data.zoom.centre[axis] - half, data.zoom.centre[axis] + half];
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      const place = axis === 0 ? at([value, 0])[1] : at([0, value])[0];
      inside.append(drawn("line", axis === 0 ? { x1: edge, x2: size, y1: place, y2: place, stroke: "var(--line)" }
        : { x1: place, x2: place, y1: 0, y2: inner, stroke: "var(--line)" }));
      const label = String(Math.round(value * 10) / 10).replace("-", "\u2212");
      if (axis === 0 && place > 12 && place < inner - 4) svg.append(words(edge - 4, place + 4, label, { "text-anchor": "end" }));
      if (axis === 1 && place > edge + 8 && place < size - 12) svg.append(words(place, inner + 13, label, { "text-anchor": "middle" }));
    }
  }
  for (const lift of data.lifts) inside.append(lineIn(view, lift, { "stroke-width": 1, opacity: 0.4 * lift.weight }));
  for (const line of data.lines) if (!line.feet) inside.append(lineIn(view, line, { "stroke-width": 2.4 }));
  const found = data.marks.filter((one) => one.kind === "found"), model = data.marks.find((one) => one.kind === "model");
  if (model && found.length === 1) {
    const [a, b] = [at(model.at), at(found[0].at)];
    inside.append(drawn("line", { x1: a[0], y1: a[1], x2: b[0], y2: b[1], stroke: "var(--muted)", "stroke-dasharray": "2 3" }));
  }
  for (const one of data.marks) {
    const [x, y] = at(one.at), colour = colourOf(data, one);
    if (one.ellipse) {
      inside.append(drawn("ellipse", { cx: x, cy: y, rx: one.ellipse.minor * view.scale, ry: one.ellipse.major * view.scale,
        transform: `rotate(${-one.ellipse.angle} ${x} ${y})`, fill: colour, "fill-opacity": 0.22, stroke: colour, "stroke-width": 1.5 }));
    }
    inside.append(mark(one.kind, x, y, one.kind === "found" ? 3.5 : 5, colour));
    if (found.length > 1) inside.append(words(x + 8, y - 8, one.label));
  }
  svg.append(inside, drawn("rect", { x: edge, y: 0.5, width: inner - 0.5, height: inner - 0.5, fill: "none", stroke: "var(--muted)" }));
  svg.append(words(edge + inner / 2, size - 6, "y, left [mm]", { "text-anchor": "middle" }));
  svg.append(words(10, inner / 2, "x, forward [mm]", { "text-anchor": "middle", transform: `rotate(-90 10 ${inner / 2})` }));
  return svg;
}

function millimetres([x, y]) {
  return `x ${x.toFixed(2)}, y ${y.toFixed(2)} mm`.replaceAll("-", "\u2212");
}

function planView(data) {
  const key = element("ul");
  const add = (symbol, label, place) => key.append(element("li", {}, symbol, element("span", {}, label), element("span", {}, place)));
  const sample = (...children) => drawn("svg", { viewBox: "0 0 18 14", "aria-hidden": "true" }, ...children);
  for (const one of data.marks) {
    add(sample(mark(one.kind, 9, 7, 4, colourOf(data, one))), `CoM, ${one.label}${one.ellipse ? ", 95 % ellipse" : ""}`, millimetres(one.at));
  }
  for (const line of data.lines) {
    const stroke = { x1: 0, x2: 18, y1: 7, y2: 7, stroke: DIAGONAL_COLOURS[line.diagonal], "stroke-width": 2, "stroke-dasharray": DIAGONAL_DASHES[line.diagonal] };
    const told = line.feet ? "line through the feet" : "support line found";
    add(sample(drawn("line", stroke)), `${told} ${line.diagonal}`, data.lifts.length ? "thin: its lifts" : "");
  }
  const pictures = data.feet ? [overview(data), closeUp(data)] : [closeUp(data)];
  pictures[0].setAttribute("aria-label", data.caption);
  if (pictures[1]) pictures[1].setAttribute("aria-hidden", "true");
  return element("figure", {}, element("div", { class: "panels" }, ...pictures), key);
}
