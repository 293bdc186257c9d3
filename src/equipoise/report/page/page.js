"use strict";
// The page: what stands where, and the theme.

const contents = JSON.parse(document.getElementById("contents").textContent);
const systemDark = window.matchMedia("(prefers-color-scheme: dark)");

// Storage is refused to local files here and there; the theme is then the system's until the button is used.
function stored(theme) {
  try {
    if (theme) localStorage.setItem("equipoise-theme", theme);
    return localStorage.getItem("equipoise-theme");
  } catch {
    return theme;
  }
}

let picked = stored();
const chosenTheme = () => picked || (systemDark.matches ? "dark" : "light");

function applyTheme(theme) {
  document.documentElement.dataset.theme = theme;
  document.getElementById("theme").setAttribute("aria-pressed", String(theme === "dark"));
  for (const figure of figures) if (figure.drawn) draw(figure);
}

function alertOf(alert) {
  const message = element("span", {}, element("b", {}, alert.name), ` ${alert.message}`);
  if (alert.message.length < 200) return element("p", {}, message);
  return element("p", {}, element("span", { class: "short", title: alert.message }, ...message.childNodes));
}

function blockOf(block) {
  if (block.type === "table") return tableOf(block);
  if (block.type === "figure") return figureOf(block);
  if (block.type === "figures") return element("div", { class: "figures" }, ...block.figures.map(figureOf));
  if (block.type === "items") return element("ul", {}, ...block.items.map((item) => element("li", {}, item)));
  return element("p", {}, block.text);
}

function sectionOf(section) {
  document.getElementById("contents-of-page").append(element("a", { href: `#${section.id}` }, section.title));
  const heading = element("h2", { id: `${section.id}-title` }, section.title);
  return element("section", { id: section.id, "aria-labelledby": heading.id }, heading, ...section.blocks.map(blockOf));
}

function show() {
  for (const name of ["title", "subtitle", "lead"]) document.getElementById(name).textContent = contents[name];
  document.getElementById("alerts").append(...contents.alerts.map(alertOf));
  document.getElementById("numbers").append(tableOf(contents.numbers), barKey(contents.numbers),
    ...contents.legend.map((sentence) => element("p", { class: "key" }, sentence)));
  if (contents.plan_view) document.getElementById("plan-view").append(planView(contents.plan_view));
  else document.getElementById("first").classList.add("alone");
  document.getElementById("sections").append(...contents.sections.map(sectionOf));
}

// Called at the end of the file: Plotly's text is not complete before.
function whenReady() {
  for (const figure of figures) nearWindow.observe(figure.plot);
  document.getElementById("theme").addEventListener("click", () => {
    picked = chosenTheme() === "dark" ? "light" : "dark";
    stored(picked);
    applyTheme(picked);
  });
  document.getElementById("print").addEventListener("click", () => drawAll().then(() => window.print()));
  systemDark.addEventListener("change", () => applyTheme(chosenTheme()));
  window.addEventListener("beforeprint", beforePrint);
  window.addEventListener("afterprint", afterPrint);
}

applyTheme(chosenTheme());
show();
