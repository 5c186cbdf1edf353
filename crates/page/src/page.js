"use strict";
(() => {
  // Colours are read from the page's style, again whenever that changes.
  let known = new Map();
  const colour = (name) => {
    if (!known.has(name)) known.set(name, getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim());
    return known.get(name);
  };
  const faint = (name, share) => `color-mix(in srgb, ${colour(name)} ${100 * share}%, transparent)`;
  const element = (name, of, text) => {
    const made = document.createElement(name);
    if (of) made.className = of;
    if (text !== undefined) made.textContent = text;
    return made;
  };
  const font = "11px system-ui, sans-serif";
  const narrow = () => matchMedia("(max-width: 36rem)").matches;

  // Plots of one group share what is zoomed to; null is all of it.
  const groups = new Map();
  const plots = [];
  let alone = 0;
  const groupOf = (name) => {
    const key = name || "plot " + alone++;
    if (!groups.has(key)) groups.set(key, { key, shown: null, members: [], buttons: [] });
    return groups.get(key);
  };
  const show = (group, shown) => {
    group.shown = shown;
    for (const member of group.members) {
      const [min, max] = shown || member.home;
      member.plot.batch(() => {
        member.plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
        member.plot.setScale("x", { min, max });
      });
    }
    for (const button of group.buttons) button.hidden = !shown;
  };
  const home = (group) => {
    const ends = group.members.map((member) => member.home);
    return [Math.min(...ends.map((end) => end[0])), Math.max(...ends.map((end) => end[1]))];
  };
  // On a logarithmic axis, equal ways are equal ratios.
  const scaled = (member, x) => (member.log ? Math.log(x) : x);
  const unscaled = (member, x) => (member.log ? Math.exp(x) : x);
  const move = (member, at, zoom, shift) => {
    const all = home(member.group).map((x) => scaled(member, x));
    const [from, to] = (member.group.shown || home(member.group)).map((x) => scaled(member, x));
    const length = Math.max((to - from) / zoom, (all[1] - all[0]) * 1e-5);
    if (length >= (all[1] - all[0]) * 0.999) return show(member.group, null);
    let begin = from + at * (to - from) - at * length + shift * length;
    begin = Math.min(Math.max(begin, all[0]), all[1] - length);
    show(member.group, [unscaled(member, begin), unscaled(member, begin + length)]);
  };

  const decoded = (data) => {
    const scale = 10 ** data.places;
    const places = data.tables.map((steps) => {
      let at = 0;
      return steps.map((step) => (at += step) / scale);
    });
    for (const panel of data.panels) {
      const of = 10 ** panel.places;
      const values = (list) => {
        let at = 0;
        return list.map((step) => (step === null ? null : (at += step) / of));
      };
      for (const series of panel.series) {
        series.columns = [places[series.x], values(series.y)];
        if (series.low) series.columns.push(values(series.low));
      }
    }
    return data;
  };

  const number = (value, places) => {
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-4 || size >= 1e6)) return value.toExponential(2);
    return String(Number(Number(value.toFixed(Math.max(0, Math.min(places, 12)))).toPrecision(5)));
  };

  // The curves of one panel: data, how they are drawn, and the entries of the legend.
  const curves = (panel) => {
    const series = [{}];
    const bands = [];
    const entries = [];
    const crosses = [];
    for (const given of panel.series) {
      const ink = "s" + given.colour;
      const first = series.length;
      const area = given.mark === "band" || given.mark === "zone";
      const dots = given.mark === "dots" || given.mark === "crosses";
      const one = { label: given.name, points: { show: false }, width: 1.5, pxAlign: 0, stroke: () => colour(ink) };
      if (area) {
        series.push({ ...one, width: 0, stroke: undefined }, { ...one, width: 0, stroke: undefined });
        const share = given.mark === "band" ? 0.22 : 0.12;
        bands.push({ series: [first, first + 1], fill: () => faint(ink, share) });
      } else if (given.mark === "crosses") {
        series.push({ ...one, paths: () => null });
        crosses.push([first, ink]);
      } else if (dots) {
        const fill = () => faint(ink, 0.75);
        series.push({ ...one, paths: () => null, points: { show: true, size: 4, width: 0, stroke: fill, fill } });
      } else {
        if (given.mark === "dashed") one.dash = [6, 4];
        if (given.mark === "steps") one.paths = uPlot.paths.stepped({ align: 1 });
        series.push(one);
      }
      // A lone series needs no name: what the axis shows is what it is.
      const lone = !given.name && !area && !panel.series.some((other) => other.name && !["band", "zone"].includes(other.mark));
      if (given.name || (lone && !entries.some((entry) => !entry.given.name))) entries.push({ given, first, last: series.length - 1 });
    }
    const tables = panel.series.map((given) => given.columns);
    const same = tables.every((table) => table[0] === tables[0][0]);
    const data = same ? [tables[0][0], ...tables.flatMap((table) => table.slice(1))] : uPlot.join(tables);
    return { series, bands, entries, crosses, data };
  };

  const build = (figure) => {
    const data = decoded(JSON.parse(figure.querySelector("script").textContent));
    const group = groupOf(data.group);
    const reset = element("button", "reset", "Show all");
    reset.type = "button";
    reset.hidden = !group.shown;
    reset.onclick = () => show(group, null);
    group.buttons.push(reset);
    figure.append(reset);
    data.panels.forEach((panel, index) => {
      const member = { figure, panel, group, home: data.range, log: data.log };
      addPanel(member, data, index);
    });
    watch.observe(figure);
  };

  const addPanel = (member, data, index) => {
    const { figure, panel, group } = member;
    const last = index === data.panels.length - 1;
    const { series, bands, entries, crosses, data: columns } = curves(panel);
    const legend = element("div", "legend");
    legend.append(element("span", "what", panel.title));
    for (const entry of entries) {
      entry.read = element("span", "read");
      if (!entry.given.name) {
        legend.firstChild.after(entry.read);
        continue;
      }
      const button = element("button");
      button.type = "button";
      button.title = "Show or hide";
      button.setAttribute("aria-pressed", "true");
      button.append(element("span", `swatch ${entry.given.mark} c${entry.given.colour}`), entry.given.name, entry.read);
      button.onclick = () => {
        const shown = button.getAttribute("aria-pressed") !== "true";
        button.setAttribute("aria-pressed", String(shown));
        member.plot.setSeries(entry.first, { show: shown });
        if (entry.last > entry.first) member.plot.setSeries(entry.last, { show: shown });
      };
      legend.append(button);
    }
    const time = element("span", "read");
    legend.append(time);
    const holder = element("div", "panel");
    figure.append(legend, holder);

    const px = devicePixelRatio;
    const shade = (plot) => {
      const { ctx, bbox } = plot;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      data.spans.forEach((span, place) => {
        const [from, to] = [span.from, span.to].map((x) => plot.valToPos(x, "x", true));
        if (to < bbox.left || from > bbox.left + bbox.width) return;
        if (place % 2) {
          ctx.fillStyle = colour("shade");
          ctx.fillRect(from, bbox.top, to - from, bbox.height);
        }
      });
      for (const [low, high] of panel.bands) {
        const [bottom, top] = [low, high].map((y) => plot.valToPos(y, "y", true));
        ctx.fillStyle = faint("s2", 0.15);
        ctx.fillRect(bbox.left, top, bbox.width, bottom - top);
      }
      ctx.restore();
    };
    const line = (plot, from, to, words, dash) => {
      const { ctx } = plot;
      ctx.strokeStyle = colour("soft");
      ctx.lineWidth = px;
      ctx.setLineDash(dash.map((length) => length * px));
      ctx.beginPath();
      ctx.moveTo(...from);
      ctx.lineTo(...to);
      ctx.stroke();
      if (!words) return;
      ctx.font = `${10 * px}px system-ui, sans-serif`;
      ctx.fillStyle = colour("soft");
      ctx.textAlign = "right";
      // Above a line across where there is room, else below it.
      const below = from[1] === to[1] && to[1] - plot.bbox.top < 14 * px;
      ctx.textBaseline = below ? "top" : "bottom";
      ctx.fillText(words, to[0] - 3 * px, from[0] === to[0] ? to[1] : to[1] + (below ? 3 : -2) * px);
    };
    const marks = (plot) => {
      const { ctx, bbox } = plot;
      ctx.save();
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      for (const span of index === 0 ? data.spans : []) {
        const [from, to] = [span.from, span.to].map((x) => plot.valToPos(x, "x", true));
        const begin = Math.max(from, bbox.left);
        const room = Math.min(to, bbox.left + bbox.width) - begin;
        ctx.font = `${10 * px}px system-ui, sans-serif`;
        if (ctx.measureText(span.name).width + 8 * px >= room) continue;
        ctx.fillStyle = colour("soft");
        ctx.textAlign = "left";
        ctx.textBaseline = "top";
        ctx.fillText(span.name, begin + 4 * px, bbox.top + 3 * px);
      }
      for (const [y, words] of panel.levels) {
        const at = plot.valToPos(y, "y", true);
        line(plot, [bbox.left, at], [bbox.left + bbox.width, at], words, words ? [4, 3] : []);
      }
      for (const [x, words] of data.marks) {
        const at = plot.valToPos(x, "x", true);
        line(plot, [at, bbox.top], [at, bbox.top + bbox.height], last ? words : "", [3, 3]);
      }
      for (const [at, ink] of crosses) {
        if (!plot.series[at].show) continue;
        const size = 4 * px;
        ctx.strokeStyle = colour(ink);
        ctx.lineWidth = 1.6 * px;
        ctx.setLineDash([]);
        ctx.beginPath();
        plot.data[at].forEach((y, place) => {
          if (y == null) return;
          const [cx, cy] = [plot.valToPos(plot.data[0][place], "x", true), plot.valToPos(y, "y", true)];
          ctx.moveTo(cx - size, cy - size);
          ctx.lineTo(cx + size, cy + size);
          ctx.moveTo(cx - size, cy + size);
          ctx.lineTo(cx + size, cy - size);
        });
        ctx.stroke();
      }
      ctx.restore();
    };
    // Of series at other times, the nearest value is read off.
    const nearest = (plot, of, hovered) => {
      if (of === 0) return hovered;
      const values = plot.data[of];
      for (let away = 0; away < 400; away++) {
        if (values[hovered - away] != null) return hovered - away;
        if (values[hovered + away] != null) return hovered + away;
      }
      return hovered;
    };
    const read = (plot) => {
      const { idx, idxs } = plot.cursor;
      time.textContent = idx == null || index > 0 ? "" : `${data.x.split(",")[0]} ${number(plot.data[0][idx], data.places)}`;
      for (const entry of entries) {
        const at = (of) => (idxs && idxs[of] != null ? plot.data[of][idxs[of]] : null);
        const [high, low] = [at(entry.first), at(entry.last)];
        const told = (value) => number(value, panel.places);
        entry.read.textContent = idx == null || high == null ? "" : entry.last > entry.first ? `${told(low)} to ${told(high)}` : told(high);
      }
    };
    const y = (plot, low, high) => {
      if (panel.y && (panel.fixed || !group.shown)) return panel.y;
      if (low == null) return panel.y || [0, 1];
      const room = high > low ? 0.06 * (high - low) : 0.1 * Math.abs(high) || 1;
      return [low - room, high + room];
    };
    const axis = {
      font,
      stroke: () => colour("soft"),
      grid: { stroke: () => colour("grid"), width: 1 },
      ticks: { stroke: () => colour("line"), width: 1, size: 4 },
      gap: 4,
    };
    const decimals = (values) => {
      const step = values.length > 1 ? Math.abs(values[1] - values[0]) : 1;
      let places = 0;
      while (places < 12 && Math.abs(step * 10 ** places - Math.round(step * 10 ** places)) > 1e-6 * step * 10 ** places) places++;
      return values.map((value) => (value == null ? null : Math.abs(value) >= 1e6 ? value.toExponential(1) : value.toFixed(places)));
    };
    const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
    const size = () => ({ width: Math.max(holder.clientWidth, 160), height: (panel.low ? 6.5 : 10.5) * rem - 1.45 * rem + (last ? 38 : 6) });
    const drag = (event) => {
      const box = member.plot.over.getBoundingClientRect();
      let from = event.clientX;
      const pan = (moved) => {
        move(member, 0, 1, (from - moved.clientX) / box.width);
        from = moved.clientX;
      };
      const end = () => {
        removeEventListener("mousemove", pan);
        removeEventListener("mouseup", end);
      };
      addEventListener("mousemove", pan);
      addEventListener("mouseup", end);
    };
    const [min, max] = group.shown || member.home;
    member.plot = new uPlot(
      {
        ...size(),
        series,
        bands,
        padding: [6, 14, last ? 0 : 2, 0],
        legend: { show: false },
        scales: { x: { time: false, min, max, range: (_, low, high) => [low, high], ...(data.log ? { distr: 3 } : {}) }, y: { range: y } },
        axes: [
          last ? { ...axis, size: 22, label: data.x, labelSize: 16, labelFont: font, labelGap: 2, ...(data.log ? {} : { values: (_, values) => decimals(values) }) } : { ...axis, size: 0, values: () => [], ticks: { show: false } },
          { ...axis, size: narrow() ? 42 : 54, space: panel.low ? 18 : 26, values: (_, values) => decimals(values) },
        ],
        cursor: {
          y: false,
          points: { size: 6, show: true },
          dataIdx: nearest,
          drag: { x: true, y: false, setScale: false, dist: 4 },
          sync: { key: group.key, scales: ["x", null], filters: { pub: (type) => type === "mousemove" || type === "mouseleave" } },
          bind: {
            mousedown: (_, __, usual) => (event) => {
              if (event.button !== 0) return null;
              if (!event.shiftKey) return usual(event);
              drag(event);
              return null;
            },
            dblclick: () => () => {
              show(group, null);
              return null;
            },
          },
        },
        hooks: {
          drawClear: [shade],
          draw: [marks],
          setCursor: [read],
          setSelect: [
            (plot) => {
              const { left, width } = plot.select;
              if (width < 4) return;
              const ends = [left, left + width].map((at) => plot.posToVal(at, "x"));
              queueMicrotask(() => show(group, ends));
            },
          ],
        },
      },
      columns,
      holder,
    );
    member.size = size;
    group.members.push(member);
    plots.push(member);
    bindTouch(member);
    holder.addEventListener(
      "wheel",
      (event) => {
        const box = member.plot.over.getBoundingClientRect();
        const at = Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
        if (event.ctrlKey || event.metaKey) move(member, at, event.deltaY < 0 ? 1.25 : 0.8, 0);
        else if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) move(member, 0, 1, (event.deltaX || event.deltaY) / box.width);
        // A plain wheel goes down the page.
        else return;
        event.preventDefault();
      },
      { passive: false },
    );
  };

  // Two fingers zoom, one pans what is zoomed; up and down the page scrolls.
  const bindTouch = (member) => {
    const fingers = new Map();
    const over = member.plot.over;
    over.addEventListener("pointerdown", (event) => event.pointerType === "touch" && fingers.set(event.pointerId, event.clientX));
    const lift = (event) => fingers.delete(event.pointerId);
    for (const type of ["pointerup", "pointercancel", "pointerleave"]) over.addEventListener(type, lift);
    over.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      const box = over.getBoundingClientRect();
      const before = [...fingers.values()];
      fingers.set(event.pointerId, event.clientX);
      const after = [...fingers.values()];
      if (after.length === 1 && member.group.shown) move(member, 0, 1, (before[0] - after[0]) / box.width);
      if (after.length === 2) {
        const spread = ([a, b]) => Math.max(Math.abs(a - b), 10);
        move(member, ((after[0] + after[1]) / 2 - box.left) / box.width, spread(after) / spread(before), 0);
      }
    });
  };

  const keys = (event) => {
    const member = plots.find((one) => one.figure === event.currentTarget);
    if (!member || event.target !== event.currentTarget || event.ctrlKey || event.metaKey || event.altKey) return;
    const plot = member.plot;
    const width = plot.over.clientWidth;
    const left = plot.cursor.left >= 0 ? plot.cursor.left : width / 2;
    const step = event.key === "ArrowLeft" ? -1 : 1;
    if (event.key === "ArrowLeft" || event.key === "ArrowRight") {
      if (event.shiftKey) move(member, 0, 1, 0.1 * step);
      else plot.setCursor({ left: Math.min(Math.max(left + (step * width) / 100, 0), width), top: 10 }, true, true);
    } else if (event.key === "+" || event.key === "=") move(member, left / width, 1.5, 0);
    else if (event.key === "-") move(member, left / width, 1 / 1.5, 0);
    else if (event.key === "Escape" || event.key === "0") show(member.group, null);
    else return;
    event.preventDefault();
  };

  const figures = [...document.querySelectorAll("[data-plot]")];
  const begin = (figure) => {
    if (figure.dataset.plot === "drawn") return;
    figure.dataset.plot = "drawn";
    build(figure);
  };
  const fit = (member) => {
    const size = member.size();
    if (member.figure.clientWidth && size.width !== member.plot.width) member.plot.setSize(size);
  };
  const watch = new ResizeObserver((entries) => {
    for (const entry of entries) plots.filter((member) => member.figure === entry.target).forEach(fit);
  });
  // Of a long page, what comes near is drawn.
  const near = new IntersectionObserver(
    (entries) => {
      for (const entry of entries.filter((one) => one.isIntersecting)) {
        near.unobserve(entry.target);
        begin(entry.target);
      }
    },
    { rootMargin: "600px" },
  );
  for (const figure of figures) {
    near.observe(figure);
    figure.addEventListener("keydown", keys);
  }
  (figures[0].closest(".grid") || figures[0].closest("details") || figures[0]).before(
    element("p", "hint", "Plots: drag to zoom, shift-drag to pan, Ctrl and wheel to zoom, double click to show all; two fingers on a phone. With the keyboard: arrows read off, + and - zoom, Shift and arrows pan, Escape shows all. Long series are drawn by the least and the greatest value of each of 5,000 stretches of time."),
  );

  const repaint = () => {
    known = new Map();
    for (const member of plots) member.plot.redraw(false, true);
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaint);
  addEventListener("beforeprint", () => {
    document.documentElement.dataset.paper = "";
    for (const figure of figures) if (figure.clientWidth) begin(figure);
    repaint();
  });
  addEventListener("afterprint", () => {
    delete document.documentElement.dataset.paper;
    repaint();
  });

  // The table of contents says where one is.
  const contents = document.querySelector(".toc details");
  if (contents && contents.querySelectorAll("a").length > 8 && matchMedia("(max-width: 62rem)").matches) contents.open = false;
  const links = new Map([...document.querySelectorAll(".toc a")].map((link) => [link.hash.slice(1), link]));
  const seen = new Set();
  const mark = new IntersectionObserver(
    (entries) => {
      for (const entry of entries) entry.isIntersecting ? seen.add(entry.target.id) : seen.delete(entry.target.id);
      const inside = [...links.keys()].filter((id) => seen.has(id));
      for (const [id, link] of links) id === inside[inside.length - 1] ? link.setAttribute("aria-current", "true") : link.removeAttribute("aria-current");
    },
    { rootMargin: "0px 0px -70% 0px" },
  );
  for (const id of links.keys()) if (document.getElementById(id)) mark.observe(document.getElementById(id));
})();
