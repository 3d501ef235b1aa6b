"use strict";
(async () => {
  const place = document.getElementById("timeline");
  if (!place) return;

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
    place.textContent = "This browser cannot unpack the interactive plots; a current one can.";
    return;
  }

  const PRINT = { ink: "#171a1f", muted: "#646b76", line: "#e4e2dc", card: "#ffffff" };
  const screen = () => {
    const style = getComputedStyle(document.documentElement);
    return Object.fromEntries(Object.keys(PRINT).map((name) => [name, style.getPropertyValue("--" + name).trim()]));
  };
  const theme = ({ ink, muted, line, card }) => {
    const colours = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", "font.color": ink,
      "font.family": "system-ui, sans-serif", "hoverlabel.bgcolor": card, "hoverlabel.bordercolor": line,
      "hoverlabel.font.color": ink, "modebar.bgcolor": "rgba(0,0,0,0)", "modebar.color": muted,
      "modebar.activecolor": ink,
    };
    for (const axis of ["xaxis", "yaxis", "yaxis2"]) {
      colours[axis + ".gridcolor"] = line;
      colours[axis + ".zerolinecolor"] = line;
      colours[axis + ".linecolor"] = line;
    }
    return colours;
  };

  const figure = JSON.parse(document.getElementById("figure").textContent);
  if (innerWidth < 640) Object.assign(figure.layout, { height: 720, margin: { l: 44, r: 6, t: 150, b: 40 } });
  await Plotly.newPlot(place, figure.data, figure.layout, {
    responsive: true, displaylogo: false,
    modeBarButtons: [["toImage", "zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]],
  });
  const paint = (colours) => Plotly.relayout(place, theme(colours));
  await paint(screen());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => paint(screen()));
  addEventListener("beforeprint", () => paint(PRINT));
  addEventListener("afterprint", () => paint(screen()));
})();
