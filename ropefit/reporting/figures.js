"use strict";
// Draws the page's figures as SVG from plain traces and axes, in the page's own colours.
const Figures = (() => {
  const OWN = { ink: "var(--ink)", soft: "var(--soft)", ground: "var(--ground)", band: "var(--soft)" };
  const DASHES = { dot: "2 4", dash: "7 5" };
  const LINE = 19;  // [px] from one label to the next below it
  const colour = (name) => OWN[name] || name;
  const plain = (text) => String(text).replace(/&lt;/g, "<").replace(/&gt;/g, ">").replace(/&#39;/g, "'")
    .replace(/&#34;/g, '"').replace(/&amp;/g, "&");
  const safe = (text) => plain(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/"/g, "&quot;");
  // Text with <sub> and <sup>, in SVG and in HTML.
  const raised = (text) => safe(text).replace(/&lt;(su[bp])>(.*?)&lt;\/su[bp]>/g, (_, kind, inner) =>
    `<tspan dy="${kind === "sub" ? 3 : -5}" font-size="9">${inner}</tspan><tspan dy="${kind === "sub" ? -3 : 5}">​</tspan>`);
  const rich = (text) => safe(text).replace(/&lt;(\/?su[bp])>/g, "<$1>");
  const known = (v) => v !== null && v !== undefined && Number.isFinite(v);
  const number = (v) => String(+v.toPrecision(4)).replace("-", "−");

  function ticks(low, high, count) {
    const raw = (high - low) / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999), out = [];
    for (let k = Math.ceil(low / step - 1e-6); k * step <= high + 1e-6 * step; k++) out.push(+(k * step).toPrecision(10));
    return out;
  }

  // One axis: its range, its place on the paper, its ticks.
  function scale(axis, values, from, to) {
    const names = values.some((v) => typeof v === "string") || axis.names;
    if (names) {
      const given = axis.names || [...new Set(values)], list = axis.reversed ? given.slice().reverse() : given, step = (to - from) / list.length;
      const place = (v) => from + (list.indexOf(v) + 0.5) * step;
      return { place, step: Math.abs(step), ticks: list.map((v) => [place(v), v]), low: 0, high: list.length };
    }
    const log = axis.type === "log", size = (v) => (log ? Math.log10(v) : v);
    const found = values.filter((v) => known(v) && (!log || v > 0)).map(size);
    let [low, high] = axis.range || [Math.min(...found), Math.max(...found)];
    if (!found.length && !axis.range) [low, high] = [0, 1];
    if (!axis.range) {
      if (axis.rangemode === "tozero") [low, high] = [Math.min(low, 0), Math.max(high, 0)];
      const edge = (high - low || Math.abs(high) || 1) * (axis.tight ? 0 : 0.05);
      low = axis.rangemode === "tozero" && low === 0 ? 0 : low - edge;
      high = axis.rangemode === "tozero" && high === 0 ? 0 : high + edge;
    }
    if (low === high) high = low + 1;  // zeros only
    if (axis.reversed) [low, high] = [high, low];
    const place = (v) => from + ((size(v) - low) / (high - low)) * (to - from);
    const bounds = [Math.min(low, high), Math.max(low, high)], most = Math.abs(to - from) / (axis.across ? 70 : 38);
    let at = axis.tickvals;
    if (!at && log) at = ticks(Math.floor(bounds[0]), Math.ceil(bounds[1]), Math.max(2, most)).filter(Number.isInteger)
      .map((v) => 10 ** v).filter((v) => size(v) >= bounds[0] - 1e-9 && size(v) <= bounds[1] + 1e-9);
    if (log && at.length < 2) at = [10 ** bounds[0], 10 ** ((bounds[0] + bounds[1]) / 2), 10 ** bounds[1]].map((v) => +v.toPrecision(2));
    at = (at || ticks(...bounds, most)).filter((v) => !axis.whole || Number.isInteger(v));
    return { place, low, high, back: (p) => low + ((p - from) / (to - from)) * (high - low),
      ticks: at.map((v, i) => [place(v), axis.ticktext ? axis.ticktext[i] : number(v)]) };
  }

  function mixed(stops, share) {
    const parts = (text) => text.startsWith("#") ? [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16)).concat(1)
      : text.slice(5, -1).split(",").map(Number);
    const next = Math.max(1, stops.findIndex(([at]) => at >= share)), [a, b] = [stops[next - 1], stops[next]];
    const w = b[0] > a[0] ? Math.min(1, Math.max(0, (share - a[0]) / (b[0] - a[0]))) : 0, one = parts(a[1]), two = parts(b[1]);
    return `rgba(${one.map((v, i) => +(v + w * (two[i] - v)).toFixed(3)).join(",")})`;
  }

  const edges = (at) => at.length === 1 ? [at[0] - 0.5, at[0] + 0.5]
    : [at[0] - (at[1] - at[0]) / 2, ...at.slice(1).map((v, i) => (v + at[i]) / 2), at.at(-1) + (at.at(-1) - at.at(-2)) / 2];

  function heat(trace, x, y, left, top, wide, high) {
    const canvas = document.createElement("canvas"), fine = 2, ink = canvas.getContext("2d");
    canvas.width = Math.max(1, wide * fine);
    canvas.height = Math.max(1, high * fine);
    const xs = edges(trace.x).map((v) => (x.place(v) - left) * fine), ys = edges(trace.y).map((v) => (y.place(v) - top) * fine);
    let text = "";
    trace.z.forEach((row, i) => row.forEach((z, j) => {
      if (!known(z)) return;
      ink.fillStyle = mixed(trace.colorscale, (z - trace.zmin) / (trace.zmax - trace.zmin));
      const [a, b, c, d] = [xs[j], xs[j + 1], Math.min(ys[i], ys[i + 1]), Math.max(ys[i], ys[i + 1])].map(Math.round);
      ink.fillRect(a, c, b - a, d - c);
      if (trace.numbered) text += `<text x="${x.place(trace.x[j])}" y="${y.place(trace.y[i]) + 4}" text-anchor="middle">${z.toFixed(2).replace("-", "−")}</text>`;
    }));
    return `<image href="${canvas.toDataURL()}" x="${left}" y="${top}" width="${wide}" height="${high}" preserveAspectRatio="none"/>${text}`;
  }

  // Return the room [px] that a map needs on its right for the bar of its colours.
  const beyond = (map) => 30 + 7 * Math.max(4, ...ticks(map.zmin, map.zmax, 4).map((v) => number(v).length));

  function bar(trace, width, top, high) {
    const left = width - beyond(trace) + 6;
    const id = `s${Math.random().toString(36).slice(2)}`, at = (share) => top + high * (1 - share);
    const stops = trace.colorscale.map(([s, c]) => `<stop offset="${s}" stop-color="${c}"/>`).join("");
    const marks = ticks(trace.zmin, trace.zmax, 4).map((v) =>
      `<text x="${left + 16}" y="${at((v - trace.zmin) / (trace.zmax - trace.zmin)) + 4}">${number(v)}</text>`).join("");
    return `<linearGradient id="${id}" x1="0" y1="1" x2="0" y2="0">${stops}</linearGradient>
      <rect x="${left}" y="${top}" width="10" height="${high}" fill="url(#${id})"/>${marks}`;
  }

  const SYMBOLS = {
    diamond: (u, v, s) => `M${u - s},${v}l${s},${-s}l${s},${s}l${-s},${s}z`,
    x: (u, v, s) => `M${u - s},${v - s}l${2 * s},${2 * s}m0,${-2 * s}l${-2 * s},${2 * s}`,
    circle: (u, v, s) => `M${u - s},${v}a${s},${s} 0 1 0 ${2 * s},0a${s},${s} 0 1 0 ${-2 * s},0z`,
  };

  // Return the height [px] at which a text as long as that covers none of those taken, and take it.
  function clear(left, v, long, taken) {
    const hit = () => taken.find(([a, b, w]) => Math.abs(b - v) < LINE - 1 && a < left + long && left < a + w);
    for (let other = hit(); other; other = hit()) v = other[1] + LINE;
    taken.push([left, v, long]);
    return v;
  }

  // A trace as a path through points (u, v) on the paper; null breaks it.
  // taken: the boxes of texts already there, which a text moves down to clear.
  function drawn(trace, points, width, taken = []) {
    const mode = trace.mode || "lines", line = trace.line || {}, marker = trace.marker || {};
    let out = "";
    if (mode.includes("lines")) {
      let pen = "M", way = "";
      for (const p of points) {
        if (!p) { pen = "M"; continue; }
        way += `${pen}${p[0].toFixed(1)},${p[1].toFixed(1)}`;
        pen = "L";
      }
      out += `<path d="${way}" fill="none" stroke-linejoin="round" stroke-linecap="round" style="stroke:${colour(line.color || "ink")}"
        stroke-width="${line.width || 2}" stroke-opacity="${line.opacity || 1}" ${line.dash ? `stroke-dasharray="${DASHES[line.dash]}"` : ""}/>`;
    }
    if (mode.includes("markers")) {
      const [name, open] = (marker.symbol || "circle").split("-"), size = (marker.size || 6) / 2;
      const way = points.filter(Boolean).map(([u, v]) => (SYMBOLS[name] || SYMBOLS.circle)(+u.toFixed(1), +v.toFixed(1), size)).join("");
      const hollow = open || name === "x", paint = colour(marker.color || line.color || "ink");
      out += `<path d="${way}" opacity="${marker.opacity || 1}" style="fill:${hollow ? "none" : paint};stroke:${hollow ? paint : "none"}" stroke-width="1.5"/>`;
    }
    if (mode === "text") points.forEach((p, i) => {
      if (!p || !trace.text[i]) return;
      const long = 9 * (trace.text[i].length + 1), before = p[0] + long > width;  // no room behind the place
      const v = clear(before ? width - 4 - long : p[0] + 9, p[1] + 4, long, taken);
      out += `<text class="halo" x="${before ? width - 4 : p[0] + 9}" y="${v}" text-anchor="${before ? "end" : "start"}" style="fill:${colour(line.color || "ink")}">${raised(trace.text[i])}</text>`;
    });
    return out;
  }

  function legend(figure, data) {
    const shown = figure.layout.showlegend === false ? [] : data.filter((t) => t.name && t.showlegend !== false && t.mode !== "text" && t.type !== "heatmap");
    const title = figure.title ? `<b style="color:${colour(figure.title[1])}">${rich(figure.title[0])}</b>` : "";
    const keys = shown.length > 1 || (shown.length && figure.layout.scene) ? shown.map((t) => {
      const only = t.mode === "markers", paint = colour((only || t.type === "bar" ? t.marker : t.line || t.marker).color);
      return `<span><i class="${only || t.type === "bar" ? "dot" : "dash"}" style="background:${paint}"></i>${rich(t.name)}</span>`;
    }).join("") : "";
    return title + keys;
  }

  function flat(figure, data, width, height) {
    const { xaxis, yaxis } = figure.layout, map = data.find((t) => t.type === "heatmap" && t.showscale !== false);
    const sideways = data.some((t) => t.orientation === "h");
    // Names without room beside each other stand upright.
    const names = sideways ? [] : [...new Set(data.flatMap((t) => t.x || []))].filter((v) => typeof v === "string");
    const longest = 6.7 * Math.max(0, ...names.map((v) => v.length)), upright = longest * names.length > width - 150;
    const right = map ? beyond(map) : 14, top = 8, bottom = upright ? 34 + longest : 44, high = height - top - bottom;
    const base = data.filter((t) => t.type === "bar").length ? [0] : [];
    const across = (t) => (t.type === "heatmap" ? edges(t.x) : t.x), up = (t) => (t.type === "heatmap" ? edges(t.y) : t.y);
    const tight = { tight: !!map };
    let xs = data.flatMap(across).concat(sideways ? base : []), ys = data.flatMap(up).concat(sideways ? [] : base);
    let y = scale({ ...tight, ...yaxis }, ys, top + high, top);
    const left = 30 + 6.7 * Math.max(0, ...y.ticks.map(([, text]) => plain(text).replace(/<.*?>/g, "").length));
    const wide = Math.max(40, width - left - right);
    const whole = data.every((t) => (t.x || []).every(Number.isInteger));
    let x = scale({ ...tight, ...xaxis, across: true, whole }, xs, left, left + wide);
    if (yaxis.scaleanchor) {
      const unit = Math.max(Math.abs(x.high - x.low) / wide, Math.abs(y.high - y.low) / high);
      const grown = (s, size) => { const m = (s.low + s.high) / 2, h = (unit * size / 2) * Math.sign(s.high - s.low); return [m - h, m + h]; };
      x = scale({ ...xaxis, range: grown(x, wide), across: true }, xs, left, left + wide);
      y = scale({ ...yaxis, reversed: false, range: grown(y, high) }, ys, top + high, top);
    }
    let back = "", front = "";
    for (const [u, text] of x.ticks) back += `<path class="grid" d="M${u},${top}V${top + high}"/><text ${upright ? `transform="translate(${u + 4},${top + high + 8}) rotate(-90)" text-anchor="end"` : `x="${u}" y="${top + high + 16}" text-anchor="middle"`}>${raised(text)}</text>`;
    for (const [v, text] of y.ticks) back += `<path class="grid" d="M${left},${v}H${left + wide}"/><text x="${left - 7}" y="${v + 4}" text-anchor="end">${raised(String(text).replace(/_/g, " "))}</text>`;
    for (const s of figure.layout.shapes || []) {
      const within = (low, most) => (p) => Math.min(Math.max(p, low), most);
      const [u0, u1] = s.x.map(x.place).map(within(left, left + wide));
      const [v0, v1] = s.y ? s.y.map(y.place).map(within(top, top + high)) : [top + high, top];
      const rect = `x="${u0}" y="${v1}" width="${u1 - u0}" height="${v0 - v1}"`;
      if (s.fill) back += `<rect ${rect} style="fill:${colour(s.fill)}" opacity="0.16"/>`;
      else front += `<rect class="box" ${rect}/>`;
    }
    const bars = data.filter((t) => t.type === "bar");
    let body = "";
    for (const t of data) {
      if (t.type === "heatmap") body += heat(t, x, y, left, top, wide, high);
      else if (t.type === "bar") {
        const band = sideways ? y : x, other = sideways ? x : y, size = (0.72 * band.step) / bars.length;
        (sideways ? t.y : t.x).forEach((name, i) => {
          const value = (sideways ? t.x : t.y)[i], mid = band.place(name) + (bars.indexOf(t) - bars.length / 2) * size;
          const paint = colour(Array.isArray(t.marker.color) ? t.marker.color[i] : t.marker.color);
          const [a, b] = [other.place(0), other.place(value || 0)].sort((p, q) => p - q);
          body += sideways ? `<rect x="${a}" y="${mid}" width="${b - a}" height="${size}" style="fill:${paint}"/>`
            : `<rect x="${mid}" y="${a}" width="${size}" height="${b - a}" style="fill:${paint}"/>`;
        });
      } else body += drawn(t, t.x.map((v, i) => {
        const p = [v, t.y[i]].every((w) => typeof w === "string" || known(w)) ? [x.place(v), y.place(t.y[i])] : null;
        return p && p.every(Number.isFinite) ? p : null;
      }));
    }
    const frame = `<path class="axis" d="M${left},${top}V${top + high}H${left + wide}"/>`;
    const titles = `<text class="soft" x="${left + wide / 2}" y="${height - 6}" text-anchor="middle">${raised(xaxis.title)}</text>
      <text class="soft" transform="translate(13,${top + high / 2}) rotate(-90)" text-anchor="middle">${raised(yaxis.title)}</text>`;
    const beside = map ? bar(map, width, top, high) + `<text class="soft" transform="translate(${width - 4},${top + high / 2}) rotate(-90)" text-anchor="middle">${raised(map.title)}</text>` : "";
    const paper = { x, y, left, top, wide, high, map };
    return [`${back}${body}${frame}${front}${titles}${beside}<path class="cursor" d=""/>`, paper];
  }

  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };
  const turned = (a, about, angle) => {
    const c = Math.cos(angle), s = Math.sin(angle), side = cross(about, a), along = dot(about, a) * (1 - c);
    return a.map((v, i) => v * c + side[i] * s + about[i] * along);
  };

  function deep(figure, data, width, height, state) {
    const { low, high, eye, up } = figure.layout.scene;
    state.eye = state.eye || unit(eye);
    const right = unit(cross(up, state.eye)), above = cross(state.eye, right);
    const middle = low.map((v, i) => (v + high[i]) / 2);
    const along = (x, y, z) => { const p = [x - middle[0], y - middle[1], z - middle[2]]; return [dot(p, right), dot(p, above)]; };
    if (!state.reach) {  // of everything in every step, as it is first looked at
      state.reach = [[Infinity, Infinity], [-Infinity, -Infinity]];
      for (const step of figure.steps || [figure.data]) for (const t of step) (t.x || []).forEach((v, i) => {
        if (known(v)) along(v, t.y[i], t.z[i]).forEach((w, k) => { state.reach[0][k] = Math.min(state.reach[0][k], w); state.reach[1][k] = Math.max(state.reach[1][k], w); });
      });
    }
    const [least, most] = state.reach, spread = (k) => Math.max(most[k] - least[k], 1e-6);
    const fitted = Math.min((width - 80) / spread(0), (height - 64) / spread(1)), size = (state.zoom || 1) * fitted;
    height = Math.min(height, Math.max(240, fitted * spread(1) + 64));  // no empty paper above and below a wide rope
    const place = (x, y, z) => { const [u, v] = along(x, y, z); return [width / 2 + size * (u - (least[0] + most[0]) / 2), height / 2 - 12 - size * (v - (least[1] + most[1]) / 2)]; };
    const path = (t) => t.x.map((v, i) => (known(v) ? place(v, t.y[i], t.z[i]) : null));
    const taken = [];
    let frame = "";
    const bars = [1, 2, 5].flatMap((m) => [-3, -2, -1, 0, 1].map((p) => m * 10 ** p)).sort((a, b) => a - b);
    const length = bars.filter((v) => v * size < width / 4).at(-1) || bars[0];
    frame += `<path class="axis" d="M14,${height - 12}v-5v5h${length * size}v-5"/><text class="soft" x="${14 + (length * size) / 2}" y="${height - 19}" text-anchor="middle">${length < 0.1 ? number(1000 * length) + " mm" : number(length) + " m"}</text>`;
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, i) => {
      const u = 26 * dot(axis, right), v = -26 * dot(axis, above), at = [width - 38 + 1.3 * u, height - 34 + 1.3 * v];
      if (Math.hypot(u, v) <= 5 || taken.some(([a, b]) => Math.abs(a + 4 - at[0]) < 10 && Math.abs(b - at[1]) < 12)) return;
      taken.push([at[0] - 4, at[1], 8]);
      taken.push([width - 38 + Math.min(u, 0), height - 38 + v / 2, Math.abs(u)]);  // its line
      frame += `<path class="axis" d="M${width - 38},${height - 38}l${u},${v}"/><text class="soft" x="${at[0]}" y="${at[1]}" text-anchor="middle">${"xyz"[i]}</text>`;
    });
    const body = data.map((t) => drawn(t, path(t), width, taken)).join("") + frame;
    return [body, { up, height }];
  }

  return { flat, deep, legend, turned, dot, cross, unit, number, known };
})();
