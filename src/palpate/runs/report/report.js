"use strict";
const unfold = () => {
  const place = location.hash.length > 1 && document.getElementById(location.hash.slice(1));
  if (place && place.tagName === "DETAILS") place.open = true;
};
addEventListener("hashchange", unfold);
addEventListener("DOMContentLoaded", unfold);
addEventListener("beforeprint", () => { for (const part of document.querySelectorAll("details")) part.open = true; });
(async () => {
  const places = document.querySelectorAll("[data-figure]");
  if (!places.length) return;

  const unpack = async (id) => {
    const packed = Uint8Array.from(atob(document.getElementById(id).textContent.trim()), (c) => c.charCodeAt(0));
    return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  };
  const run = (source) => {
    const script = document.createElement("script");
    script.textContent = source;
    document.head.append(script);
  };

  try {
    run(await unpack("plotly"));
  } catch (error) {
    for (const place of places) place.textContent = "This browser cannot unpack the interactive plots; a current one can.";
    return;
  }

  const PAPER = 640; // px between the margins of A4 and of US letter
  const PRINT = { ink: "#171a1f", muted: "#646b76", line: "#e4e2dc", card: "#ffffff" };
  const screen = () => {
    const style = getComputedStyle(document.documentElement);
    return Object.fromEntries(Object.keys(PRINT).map((name) => [name, style.getPropertyValue("--" + name).trim()]));
  };
  const theme = ({ ink, muted, line, card }, layout) => {
    const colours = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", "font.color": ink,
      "font.family": "system-ui, sans-serif", "hoverlabel.bgcolor": card, "hoverlabel.bordercolor": line,
      "hoverlabel.font.color": ink, "modebar.bgcolor": "rgba(0,0,0,0)", "modebar.color": muted,
      "modebar.activecolor": ink,
    };
    for (const axis of Object.keys(layout).filter((name) => /^[xy]axis/.test(name))) {
      colours[axis + ".gridcolor"] = line;
      colours[axis + ".zerolinecolor"] = line;
      colours[axis + ".linecolor"] = line;
    }
    return colours;
  };

  const drawn = [];
  for (const place of places) {
    const { data, layout } = JSON.parse(document.getElementById(place.dataset.figure).textContent);
    if (innerWidth < 640 && place.dataset.narrow) Object.assign(layout, JSON.parse(place.dataset.narrow));
    await Plotly.newPlot(place, data, layout, {
      responsive: true, displaylogo: false,
      displayModeBar: place.dataset.plain === undefined && layout.dragmode !== false ? "hover" : false,
      modeBarButtons: [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
    });
    drawn.push([place, layout]);
  }
  // In a folded part a plot has no width until that is opened.
  const fill = (event) => {
    for (const [place] of drawn) if (event.target.contains(place)) Plotly.Plots.resize(place);
  };
  for (const part of document.querySelectorAll("details")) part.addEventListener("toggle", fill);
  const paint = (colours) => Promise.all(drawn.map(([place, layout]) => Plotly.relayout(place, theme(colours, layout))));
  await paint(screen());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => paint(screen()));
  // A page of paper is narrower than the window, and the plot does not hear of it.
  const fit = (size) => Promise.all(drawn.map(([place]) => Plotly.relayout(place, size)));
  addEventListener("beforeprint", () => { fit({ autosize: false, width: PAPER }); paint(PRINT); });
  addEventListener("afterprint", () => { fit({ autosize: true, width: null }); paint(screen()); });
})();
