"use strict";
// Figures are Plotly's. It is in this file as text and becomes a script when the first figure comes near the window.

const figures = [];
const PRINTED_WIDTH = 680;
const NARROW = 500;  // [px], below which a scene is seen from farther away to be in it whole

function loadPlotly() {
  if (!window.Plotly) document.head.append(element("script", {}, document.getElementById("plotly").textContent));
}

function hasWebGL() {
  try {
    return Boolean(document.createElement("canvas").getContext("webgl"));
  } catch {
    return false;
  }
}

// Colours are given as names of the style sheet's variables, so that they follow the theme.
function themed(value, style) {
  if (typeof value === "string" && value.startsWith("--")) return style.getPropertyValue(value).trim();
  if (Array.isArray(value)) return typeof value[0] === "number" ? value : value.map((one) => themed(one, style));
  if (value && typeof value === "object") {
    return Object.fromEntries(Object.entries(value).map(([name, one]) => [name, themed(one, style)]));
  }
  return value;
}

function layoutOf(block, style, width) {
  const layout = themed(block.layout, style);
  const colour = (name) => style.getPropertyValue(name).trim();
  const axis = { gridcolor: colour("--line"), zerolinecolor: colour("--line"), linecolor: colour("--muted"), ticks: "outside",
    tickcolor: colour("--line"), automargin: true };
  const spatial = { gridcolor: colour("--line"), zerolinecolor: colour("--line"), backgroundcolor: colour("--surface"), color: colour("--muted") };
  for (const name of Object.keys(layout).filter((key) => /^[xy]axis/.test(key))) layout[name] = { ...axis, ...layout[name] };
  if (layout.scene) for (const name of ["xaxis", "yaxis", "zaxis"]) layout.scene[name] = { ...spatial, ...layout.scene[name] };
  return {
    height: block.height || 320, ...(width ? { width } : { autosize: true }),
    margin: { l: 56, r: 12, t: 12, b: 44 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", uirevision: "kept",
    font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: colour("--ink") },
    hoverlabel: { font: { size: 12 } }, bargap: 0.15, ...layout,
    legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0, ...layout.legend },
  };
}

function tracesOf(figure, style) {
  const view = figure.block.views && figure.block.views[figure.view];
  return themed(figure.block.data, style).map((trace, index) => (view ? { ...trace, visible: view.visible[index] } : trace));
}

function fartherFrom(eye, times) {
  return Object.fromEntries(Object.entries(eye).map(([axis, place]) => [axis, place * times]));
}

function draw(figure, width) {
  if (figure.refused) return Promise.resolve();
  if (figure.block.webgl && !hasWebGL()) {
    figure.refused = true;
    figure.plot.replaceChildren(element("p", { class: "muted" },
      "This browser has no WebGL, which the interactive scene needs; the picture from above shows the same in the plane."));
    return Promise.resolve();
  }
  loadPlotly();
  const style = getComputedStyle(document.documentElement), layout = layoutOf(figure.block, style, width);
  const view = figure.block.views && figure.block.views[figure.view];
  if (view) Object.assign(layout, { scene: layoutOf({ layout: view.layout }, style).scene, uirevision: view.label });
  const wide = width || figure.plot.clientWidth;  // 0 while it is not shown
  if (layout.scene && wide && wide < NARROW) {
    layout.scene.camera = { ...layout.scene.camera, eye: fartherFrom(layout.scene.camera.eye, NARROW / wide) };
  }
  const config = { displaylogo: false, responsive: true, displayModeBar: figure.block.webgl ? undefined : false };
  const drawing = figure.drawn ? Plotly.react(figure.plot, tracesOf(figure, style), layout, config)
    : Plotly.newPlot(figure.plot, tracesOf(figure, style), layout, config);
  figure.drawn = true;
  return drawing;
}

const drawAll = () => Promise.all(figures.map((figure) => draw(figure)));

const nearWindow = new IntersectionObserver((entries) => {
  for (const entry of entries) {
    const figure = figures.find((one) => one.plot === entry.target);
    if (entry.isIntersecting && figure && !figure.drawn) setTimeout(() => draw(figure), 50);  // what is there is painted first
  }
}, { rootMargin: "300px" });

function figureOf(block) {
  const plot = element("div", { class: `plot${block.webgl ? " webgl" : ""}`, role: "img", "aria-label": `${block.title}. ${block.caption}` });
  plot.style.minHeight = `${block.height || 320}px`;
  const figure = { block, plot, view: 0, drawn: false };
  const made = element("figure", {}, element("h3", {}, block.title));
  if (block.views) made.append(viewButtons(figure));
  made.append(plot);
  if (block.webgl) made.append(figure.printed = element("img", { class: "printed", alt: block.caption }));
  made.append(element("figcaption", {}, block.caption));
  figures.push(figure);
  return made;
}

function viewButtons(figure) {
  const buttons = figure.block.views.map((view, index) => {
    const button = element("button", { type: "button", "aria-pressed": String(index === 0) }, view.label);
    button.addEventListener("click", () => {
      figure.view = index;
      buttons.forEach((other, place) => other.setAttribute("aria-pressed", String(place === index)));
      draw(figure);
    });
    return button;
  });
  return element("div", { class: "views" }, ...buttons);
}

// A printer wants every figure, on white, as wide as its paper; a WebGL canvas prints blank, so its picture is taken.
function beforePrint() {
  document.documentElement.dataset.theme = "light";
  for (const figure of figures) {
    draw(figure, PRINTED_WIDTH);
    if (figure.printed && figure.drawn) takePicture(figure);
  }
}

function takePicture(figure) {
  try {
    const { _scene: scene } = figure.plot._fullLayout.scene;
    figure.printed.src = scene.toImage("png");
  } catch {
    figure.printed.remove();
  }
}

function afterPrint() {
  applyTheme(chosenTheme());
}
