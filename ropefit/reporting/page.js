"use strict";
(function () {
  const narrow = window.matchMedia("(max-width: 40rem)");
  const tip = document.body.appendChild(Object.assign(document.createElement("div"), { className: "tip" }));
  const read = (element) => JSON.parse(element.querySelector("script").textContent);
  const plots = [...document.querySelectorAll("figure.plot")].map((element) => {
    const figure = read(element);
    return { element, figure, canvas: element.querySelector(".canvas"), height: figure.height, step: 0, state: {}, enlarged: false, drawn: false };
  });

  // The traces as they are at a plot's step.
  function current(plot) {
    const { data, steps, enlarged } = plot.figure;
    const now = data.map((trace, i) => ({ ...trace, ...(steps ? steps[plot.step][i] : {}) }));
    if (plot.enlarged && enlarged) {
      const [one, other, factor] = enlarged, farther = (k) => now[one][k].map((v, i) => now[other][k][i] + factor * (v - now[other][k][i]));
      now[one] = { ...now[one], x: farther("x"), y: farther("y"), z: farther("z") };
    }
    return now;
  }

  function draw(plot) {
    const { figure, canvas } = plot, data = current(plot), width = Math.max(canvas.clientWidth, 200);
    const most = figure.layout.scene ? 1.0 * width : Infinity, height = Math.min(figure.height, most);
    const [body, paper] = (figure.layout.scene ? Figures.deep : Figures.flat)(figure, data, width, height, plot.state);
    plot.paper = paper;
    canvas.innerHTML = `<div class="legend">${Figures.legend(figure, data)}</div>
      <svg viewBox="0 0 ${width} ${paper.height || height}" role="img">${body}</svg>`;
    plot.width = width;
    plot.drawn = true;
    if (figure.columns) point(plot, main ? main.step : -1);
  }

  // Where the pointer is, in the units of the drawing.
  function place(plot, event) {
    const box = plot.canvas.querySelector("svg").getBoundingClientRect(), size = plot.width / box.width;
    return [(event.clientX - box.left) * size, (event.clientY - box.top) * size];
  }

  function cell(plot, event) {
    const { map, x, y, left, top, wide, high } = plot.paper, [u, v] = place(plot, event);
    if (u < left || u > left + wide || v < top || v > top + high) return null;
    const near = (list, value) => list.reduce((best, w, i) => (Math.abs(w - value) < Math.abs(list[best] - value) ? i : best), 0);
    const j = near(map.x, x.back(u)), i = near(map.y, y.back(v));
    return { i, j, text: `frame ${map.x[j]}, s = ${Figures.number(map.y[i])} m: ${Figures.known(map.z[i][j]) ? Figures.number(map.z[i][j]) + " " + map.title : "not seen"}` };
  }

  function nearest(plot, event) {
    const [u, v] = place(plot, event), { x, y } = plot.paper;
    let best = { far: 18 };
    for (const t of current(plot)) (t.x || []).forEach((value, k) => {
      const far = Math.hypot(x.place(value) - u, y.place(t.y[k]) - v);
      if (far < best.far) best = { far, text: `${t.name}: ${[value, t.y[k]].map((w) => (typeof w === "number" ? Figures.number(w) : w)).join(", ")}` };
    });
    return best.text ? best : null;
  }

  function listen(plot) {
    const { canvas, figure } = plot;
    if (figure.layout.scene) {
      canvas.classList.add("turns");
      let last = null;
      canvas.addEventListener("pointerdown", (e) => { last = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
      canvas.addEventListener("pointermove", (e) => {
        if (!last) return;
        const [dx, dy] = [e.clientX - last[0], e.clientY - last[1]], { up } = plot.paper;
        last = [e.clientX, e.clientY];
        let eye = Figures.turned(plot.state.eye, up, -dx / 120);
        const next = Figures.turned(eye, Figures.unit(Figures.cross(up, eye)), -dy / 120);
        if (Math.abs(Figures.dot(next, up)) < 0.98) eye = next;
        plot.state.eye = Figures.unit(eye);
        draw(plot);
      });
      for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { last = null; });
      canvas.addEventListener("dblclick", () => { plot.state = {}; draw(plot); });
      canvas.addEventListener("wheel", (e) => {
        if (!e.ctrlKey) return;
        e.preventDefault();
        plot.state.zoom = Math.min(20, Math.max(0.5, (plot.state.zoom || 1) * Math.exp(-e.deltaY / 200)));
        draw(plot);
      }, { passive: false });
      return;
    }
    const find = (e) => (plot.paper.map ? cell : nearest)(plot, e);
    canvas.addEventListener("pointermove", (e) => {
      const found = find(e);
      tip.hidden = !found;
      if (!found) return;
      tip.textContent = found.text;
      tip.style.left = `${Math.min(e.clientX + 12, innerWidth - tip.offsetWidth - 8)}px`;
      tip.style.top = `${e.clientY + 14}px`;
    });
    canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
    if (figure.columns) canvas.addEventListener("click", (e) => {
      const found = cell(plot, e);
      if (found && main) main.go(figure.columns[found.j]);
    });
  }

  // The frame that the picture shows, marked on a map.
  function point(plot, step) {
    const column = plot.figure.columns.indexOf(step), { x, top, high, map } = plot.paper;
    const way = column < 0 ? "" : `M${x.place(map.x[column])},${top}v${high}`;
    plot.canvas.querySelector(".cursor").setAttribute("d", way);
  }

  let main = null;  // the picture at the top, which the maps move
  for (const element of document.querySelectorAll(".sequence")) {
    const mine = plots.filter((plot) => element.contains(plot.canvas) && plot.figure.steps);
    const labels = JSON.parse(element.querySelector(".labels").textContent);
    const slider = element.querySelector("input[type=range]"), label = element.querySelector("output"), button = element.querySelector("button");
    const sequence = { step: Number(element.dataset.start) };
    sequence.go = (step) => {
      sequence.step = step;
      if (slider) [slider.value, label.textContent] = [step, labels[step]];
      for (const plot of mine) { plot.step = step; if (plot.drawn) draw(plot); }
      if (sequence === main) plots.filter((p) => p.figure.columns && p.drawn).forEach((p) => point(p, step));
    };
    if (element.classList.contains("main")) main = sequence;
    for (const plot of mine) plot.step = sequence.step;
    if (slider) {
      let timer = null;
      const stop = () => { clearInterval(timer); timer = null; button.textContent = "Play"; };
      slider.addEventListener("input", () => { stop(); sequence.go(Number(slider.value)); });
      button.addEventListener("click", () => {
        if (timer) return stop();
        button.textContent = "Pause";
        timer = setInterval(() => sequence.go((sequence.step + 1) % labels.length), 160);
      });
    }
    const larger = element.querySelector("input[type=checkbox]");
    if (larger) larger.addEventListener("change", () => mine.forEach((plot) => { plot.enlarged = larger.checked; draw(plot); }));
  }

  // What is folded has no width yet: it is drawn when it is opened.
  const visible = (plot) => plot.canvas.clientWidth > 0;
  const first = () => plots.filter((plot) => !plot.drawn && visible(plot)).forEach(draw);
  plots.forEach(listen);
  first();
  document.addEventListener("toggle", first, true);
  new ResizeObserver(() => plots.filter((p) => p.drawn && visible(p) && p.canvas.clientWidth !== p.width).forEach(draw)).observe(document.body);
  const unfold = () => {
    const target = location.hash && document.getElementById(location.hash.slice(1));
    if (target && target.tagName === "DETAILS") { target.open = true; target.scrollIntoView(); }
  };
  window.addEventListener("hashchange", unfold);
  narrow.addEventListener("change", () => plots.filter((p) => p.drawn).forEach(draw));
  unfold();
})();
