// Every figure waits as JSON beside its place; it is drawn in the colours of the page, again when they change, and on
// paper as wide as a sheet.
// A finger scrolls the page and does not zoom a plot, on which it would else be caught.
const dark = matchMedia("(prefers-color-scheme: dark)"), finger = matchMedia("(pointer: coarse)");
function draw(printing) {
  document.documentElement.classList.toggle("paper", printing);
  const night = dark.matches && !printing, narrow = printing || innerWidth < 600;
  const ink = night ? "#e6e9ec" : "#1b2026", line = night ? "#363d45" : "#e1e5e9";
  for (const place of document.querySelectorAll(".plot")) {
    const figure = JSON.parse(place.nextElementSibling.textContent);
    figure.layout.font = { color: ink, size: narrow ? 11 : 12.5, family: "system-ui, sans-serif" };
    const height = figure.layout.height * (figure.layout.height > 400 ? 0.7 : 0.8);  // so that a section fits a sheet
    if (printing) Object.assign(figure.layout, { width: place.clientWidth, height });
    if (finger.matches) figure.layout.dragmode = false;
    if (narrow) figure.layout.margin.l = 48;
    for (const name of Object.keys(figure.layout).filter(key => /^[xy]axis/.test(key)))
      Object.assign(figure.layout[name], { gridcolor: line, linecolor: line, tickcolor: line });
    Plotly.react(place, figure.data, figure.layout, { responsive: true, displayModeBar: false });
  }
}
draw(false);
dark.addEventListener("change", () => draw(false));
addEventListener("beforeprint", () => draw(true));
addEventListener("afterprint", () => draw(false));
