"use strict";
(function () {
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const narrow = window.matchMedia("(max-width: 40rem)");
  const config = (figure) => ({ displaylogo: false, plotlyServerURL: "",
    modeBarButtons: [figure.layout.scene ? ["toImage", "resetCameraDefault3d"]
      : ["toImage", "zoom2d", "pan2d", "resetScale2d"]] });
  const colour = (name) =>
    getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  function themed(plot) {
    const figure = plot.figure;
    const layout = JSON.parse(JSON.stringify(figure.layout));
    const ink = colour("--ink"), soft = colour("--soft"), line = colour("--line");
    layout.font = { family: "system-ui, sans-serif", size: narrow.matches ? 11 : 12, color: ink };
    layout.paper_bgcolor = layout.plot_bgcolor = "rgba(0,0,0,0)";
    layout.hoverlabel = { bgcolor: colour("--panel"), bordercolor: line, font: { color: ink } };
    layout.modebar = { bgcolor: "rgba(0,0,0,0)", color: soft, activecolor: ink };
    const paint = (axis) => Object.assign(axis,
      { gridcolor: line, zerolinecolor: line, linecolor: soft, tickcolor: soft });
    for (const key of Object.keys(layout)) {
      if (/^[xy]axis\d*$/.test(key)) paint(layout[key]);
      if (/^scene\d*$/.test(key)) {
        const eye = layout[key].camera.eye;
        const back = Math.max(1, plot.canvas.clientHeight / plot.canvas.clientWidth);
        for (const name of Object.keys(eye)) eye[name] *= back;
        for (const name of ["xaxis", "yaxis", "zaxis"])
          Object.assign(paint(layout[key][name]), { showbackground: false });
      }
    }
    for (const shape of layout.shapes || []) if (shape.fillcolor === "band") shape.fillcolor = soft;
    return layout;
  }

  function inked(trace) {
    return JSON.parse(JSON.stringify(trace), (key, value) =>
      value === "ink" ? colour("--ink") : value === "soft" ? colour("--soft")
        : value === "ground" ? colour("--ground") : value);
  }

  const plots = [...document.querySelectorAll("figure.plot")].map((element) => ({
    canvas: element.querySelector(".canvas"),
    figure: JSON.parse(element.querySelector("script").textContent),
    step: 0,
    drawn: false,
  }));

  function current(plot) {
    const data = plot.figure.data.map(inked);
    if (plot.figure.steps)
      plot.figure.steps[plot.step].forEach((arrays, i) => Object.assign(data[i], arrays));
    return data;
  }

  function draw(plot) {
    return Plotly.react(plot.canvas, current(plot), themed(plot), config(plot.figure));
  }

  function show(plot, step) {
    plot.step = step;
    if (!plot.drawn) return;
    const changes = {};
    plot.figure.steps[step].forEach((arrays, i, all) => {
      for (const key of Object.keys(arrays)) changes[key] = all.map((each) => each[key]);
    });
    return Plotly.restyle(plot.canvas, changes, plot.figure.steps[step].map((_, i) => i));
  }

  function first(plot) {
    if (plot.drawn) return;
    plot.drawn = true;
    draw(plot);
    let width = plot.canvas.clientWidth;
    new ResizeObserver(() => {
      if (plot.canvas.clientWidth === width) return;
      width = plot.canvas.clientWidth;
      Plotly.Plots.resize(plot.canvas);
    }).observe(plot.canvas);
  }

  // One figure at a time, so that the page answers while the rest are drawn; those in sight at once.
  const idle = window.requestIdleCallback || ((work) => setTimeout(work, 1));
  const next = () => {
    const plot = plots.find((each) => !each.drawn);
    if (plot) { first(plot); idle(next); }
  };
  const sight = new IntersectionObserver((seen) => seen.forEach((entry) => {
    if (entry.isIntersecting) first(plots.find((plot) => plot.canvas === entry.target));
  }));
  plots.forEach((plot) => sight.observe(plot.canvas));
  idle(next);
  window.addEventListener("beforeprint", () => plots.forEach(first));
  const again = () => plots.filter((plot) => plot.drawn).forEach(draw);
  dark.addEventListener("change", again);
  narrow.addEventListener("change", again);

  for (const sequence of document.querySelectorAll(".sequence")) {
    const mine = plots.filter((plot) => sequence.contains(plot.canvas) && plot.figure.steps);
    const slider = sequence.querySelector("input");
    if (!slider) continue;
    const label = sequence.querySelector("output"), button = sequence.querySelector("button");
    const labels = JSON.parse(sequence.querySelector(".labels").textContent);
    let timer = null;
    const go = (step) => {
      slider.value = step;
      label.textContent = labels[step];
      for (const plot of mine) show(plot, step);
    };
    const stop = () => {
      clearInterval(timer);
      timer = null;
      button.textContent = "Play";
    };
    slider.addEventListener("input", () => { stop(); go(Number(slider.value)); });
    button.addEventListener("click", () => {
      if (timer) return stop();
      button.textContent = "Pause";
      timer = setInterval(() => go((Number(slider.value) + 1) % labels.length), 160);
    });
  }
})();
