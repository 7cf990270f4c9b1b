"use strict";
// Draws every figure from the data of the page. The curves of all figures over time share their cursor.
(() => {
  const COLOURS = ["#9aa5b1", "#1f6fb2", "#c4552d", "#2c7a4b", "#7b4ea3", "#8a6100", "#0b7a75", "#ad2f6b"];
  const plots = JSON.parse(document.getElementById("plots").textContent);
  const drawn = [];
  const HEIGHT = 260;  // px
  const PRINTED = 165;  // four on a page
  const TICKS = 6;  // of a vertical axis have room, however low the plot is: one tick shows no scale

  // Ticks as short as they can be told apart, also those far from 1.
  const short = (v) => (Math.abs(v) < 1e6 ? String(v).replace(/^-?0\.0000*\d+$/, (text) => Number(text).toExponential())
    : v.toExponential());
  const ticks = (_, values) => values.map((v) => (v == null ? "" : short(Number(v.toPrecision(6)))));
  const decades = (_, values) => values.map((v) => (v != null && Math.abs(Math.log10(v) % 1) < 1e-9
    ? v.toExponential(0) : ""));
  const width = (figure) => Math.max(260, figure.clientWidth);

  function options(plot, figure) {
    const single = plot.series.length === 1;
    const series = plot.series.map((s, k) => ({
      label: s.name,
      stroke: COLOURS[(k + (single ? 1 : 0)) % COLOURS.length],
      width: 1.3,
      points: s.dots ? { show: true, size: 5, fill: COLOURS[0], stroke: COLOURS[0] } : { show: false },
      paths: s.dots ? () => null : undefined,
      value: (_, v) => (v == null ? "" : v.toPrecision(5)),
    }));
    // The limits of a band are two more series that are not named.
    const edges = plot.bands.flatMap((k) => [k, k]).map((k) => ({
      label: "", stroke: series[k].stroke + "55", width: 1, points: { show: false }, class: "edge",
    }));
    const first = plot.series.length + 1;
    const bands = plot.bands.map((k, n) => ({
      series: [first + 2 * n + 1, first + 2 * n], fill: series[k].stroke + "22",
    }));
    const scale = plot.log ? { distr: 3 } : {};
    // A logarithmic axis would end at a power of ten; that of frequencies ends with the data.
    const across = plot.log ? { ...scale, range: (_, from, to) => [from, to] } : {};
    return {
      width: width(figure), height: HEIGHT, bands,
      series: [{ label: plot.x_label, value: (_, v) => (v == null ? "" : String(v)) }, ...series, ...edges],
      legend: { markers: { fill: (_, k) => series[k - 1]?.stroke } },
      scales: { x: { time: false, ...across }, y: scale },
      axes: [{ label: plot.x_label, labelSize: 20 }, plot.log ? { size: 70, values: decades }
        : { size: 70, values: ticks, space: (_, axis, from, to, px) => Math.min(30, px / TICKS) }],
      cursor: plot.x_label === "time [s]" ? { sync: { key: "time" } } : {},
    };
  }

  // Draws a plot into a figure, or gives the one that is there new data.
  function draw(figure, plot) {
    const known = drawn.find(([other]) => other === figure);
    if (known) {
      known[1].setData(plot.data);
      return;
    }
    const chart = new uPlot(options(plot, figure), plot.data, figure);
    figure.querySelectorAll(".u-legend .edge").forEach((row) => row.remove());
    drawn.push([figure, chart]);
    document.body.dataset.drawn = String(drawn.length);
  }
  function clear() {
    drawn.splice(0).forEach(([, chart]) => chart.destroy());
    document.body.dataset.drawn = "0";
  }
  globalThis.jointId = { draw, clear, short };

  document.body.dataset.drawn = "0";
  for (const figure of document.querySelectorAll("figure[data-plot]")) draw(figure, plots[Number(figure.dataset.plot)]);
  const fit = (height) => drawn.forEach(([figure, chart]) => chart.setSize({ width: width(figure), height }));
  addEventListener("resize", () => fit(HEIGHT));
  addEventListener("beforeprint", () => fit(PRINTED));
  addEventListener("afterprint", () => fit(HEIGHT));
})();
