"use strict";
// Traces: a table with a row every 10 ms of flight time, and the plots of its columns.

class Table {
  static CELL_S = 0.01;
  static MOST = 90000;

  constructor() {
    this.time = [];
    this.columns = new Map();
    this.first = null;
  }

  // Puts the values of a row, whose first is the time, into columns; what is null stays as it was.
  put(names, row) {
    const cell = Math.floor(row[0] / Table.CELL_S + 1e-6);
    // The camera's positions come late: there is a second of room before the first row.
    if (this.first === null) this.first = Math.max(0, cell - 100);
    const index = cell - this.first;
    if (index < 0) return;
    this.grow(index + 1);
    names.forEach((name, i) => {
      if (row[i + 1] !== null && name) this.column(name)[index] = row[i + 1];
    });
  }

  grow(length) {
    while (this.time.length < length) {
      this.time.push((this.first + this.time.length) * Table.CELL_S);
      for (const column of this.columns.values()) column.push(null);
    }
    if (this.time.length > Table.MOST) {
      const old = Table.MOST / 3;
      this.first += old;
      this.time.splice(0, old);
      for (const column of this.columns.values()) column.splice(0, old);
    }
  }

  column(name) {
    if (!this.columns.has(name)) this.columns.set(name, new Array(this.time.length).fill(null));
    return this.columns.get(name);
  }

  // The last value of a column, at or before an index.
  last(name, before = this.time.length - 1) {
    const column = this.columns.get(name) ?? [];
    for (let i = Math.min(before, column.length - 1); i >= 0; i--) if (column[i] !== null) return column[i];
    return null;
  }

  // Rows of the last seconds, all for 0.
  from(seconds) {
    if (!seconds) return 0;
    return Math.max(0, this.time.length - Math.round(seconds / Table.CELL_S));
  }
}

const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

const MEASURED = { colour: "--measured", points: true };
const ESTIMATED = { colour: "--estimated" };
const WANTED = { colour: "--wanted", dash: [6, 4], steps: true };
const TRUTH = { colour: "--truth" };

// One plot: a title, and columns with how they are drawn.
class Trace {
  constructor(parent, title, unit, digits, series, options = {}) {
    this.series = series;
    this.digits = digits;
    this.box = document.createElement("div");
    this.box.className = "trace";
    const head = document.createElement("h3");
    head.append(`${title}, ${unit}`);
    this.now = document.createElement("span");
    head.append(this.now);
    this.box.append(head);
    parent.append(this.box);
    this.options = options;
    this.plot = new uPlot(this.settings(), [[], ...series.map(() => [])], this.box);
    new ResizeObserver(() => this.fit()).observe(this.box);
  }

  settings() {
    const axis = (more) => ({
      stroke: () => css("--soft"),
      grid: { stroke: () => css("--grid"), width: 1 },
      ticks: { stroke: () => css("--line"), width: 1, size: 4 },
      font: "11px system-ui, sans-serif",
      ...more,
    });
    const line = ([, { colour, points, dash, steps }]) => ({
      stroke: () => css(colour),
      width: points ? 0 : 1.8,
      dash,
      spanGaps: true,
      paths: points ? () => null : steps ? uPlot.paths.stepped({ align: 1 }) : uPlot.paths.linear(),
      points: { show: Boolean(points), size: 4, fill: () => css(colour), width: 0 },
    });
    const least = this.options.least ?? 0.1;
    return {
      width: 320,
      height: 150,
      padding: [8, 8, 0, 0],
      legend: { show: false },
      cursor: { sync: { key: "bench", setSeries: false }, drag: { x: false, y: false }, points: { show: false } },
      hooks: { setCursor: [(plot) => this.say(plot.cursor.idx)] },
      scales: {
        x: { time: false },
        y: {
          // Noise about a constant is not blown up to fill the plot.
          range: (_, low, high) => {
            if (low === null) return [0, 1];
            const room = Math.max(least - (high - low), 0.12 * (high - low)) / 2;
            return [this.options.zero ? Math.min(0, low) : low - room, high + room];
          },
        },
      },
      axes: [axis({ size: 26, space: 50 }), axis({ size: 46, space: 28 })],
      series: [{}, ...this.series.map(line)],
    };
  }

  fit() {
    const width = this.box.clientWidth;
    if (width > 0 && width !== this.plot.width) this.plot.setSize({ width, height: this.plot.height });
  }

  draw(table, from) {
    this.table = table;
    this.offset = from;
    const cut = (column) => (column ? column.slice(from) : new Array(table.time.length - from).fill(null));
    const time = table.time.slice(from);
    this.plot.setData([time, ...this.series.map(([name]) => cut(table.columns.get(name)))], true);
    if (this.plot.cursor.idx == null) this.say(null);
  }

  // The values under the cursor, or the last ones.
  say(index) {
    if (!this.table) return;
    const at = index == null ? undefined : this.offset + index;
    const words = this.series
      .filter(([, how]) => how.name !== null)
      .map(([name, how]) => {
        const value = this.table.last(name, at);
        return value === null ? null : `${how.name ? how.name + " " : ""}${value.toFixed(this.digits).replace(/^-(0\.?0*)$/, "$1")}`;
      });
    this.now.textContent = words.filter((word) => word !== null).join(" · ");
  }

  again() {
    this.plot.redraw(false, true);
  }
}

// All plots of a flight.
class Traces {
  constructor(parent, about) {
    this.table = new Table();
    const of = (name, how, more) => [name, { ...how, ...more }];
    const truth = about.truth;
    const axis = (letter, velocity) => {
      const name = (kind) => `${kind}.${velocity ? "v" : ""}${letter}`;
      const series = [of(name("measured"), MEASURED, { name: null }), of(name("estimated"), ESTIMATED)];
      if (truth) series.splice(1, 0, of(name("truth"), TRUTH, { name: null }));
      if (!velocity || letter === "z") series.push(of(name("wanted"), WANTED, { name: "set" }));
      return series;
    };
    const unit = about.unit === "1" ? "share" : about.unit;
    const digits = about.unit === "count" ? 0 : 3;
    const span = (about.sticks[1] - about.sticks[0]) / 50;
    const stick = (name, letter) => [
      of(`asked.${name}`, { colour: "--estimated", steps: true }, { name: "asked" }),
      of(`read.${name}`, MEASURED, { name: "read" }),
    ];
    const plots = [];
    const add = (...rest) => plots.push(new Trace(parent, ...rest));
    for (const letter of ["x", "y", "z"]) add(`Position ${letter}`, "m", 3, axis(letter, false));
    for (const letter of ["x", "y", "z"]) add(`Velocity ${letter}`, "m/s", 3, axis(letter, true), { least: 0.2 });
    for (const name of ["throttle", "pitch", "roll", "yaw"]) {
      add(`Output ${name}`, unit, digits, stick(name), { least: span });
    }
    if (about.mode === "hil") {
      add("Lateness", "ms", 3, [of("lateness", { colour: "--estimated" })], { least: 0.05, zero: true });
      add("Iteration took", "ms", 3, [of("took", { colour: "--measured" })], { least: 0.1, zero: true });
    }
    this.plots = plots;
  }

  take(batch) {
    const table = this.table;
    const axes = (kind) => [`${kind}.x`, `${kind}.y`, `${kind}.z`];
    const both = (kind) => [...axes(kind), `${kind}.vx`, `${kind}.vy`, `${kind}.vz`];
    const sticks = (kind) => ["throttle", "pitch", "roll", "yaw"].map((name) => `${kind}.${name}`);
    const put = (rows, names) => rows?.forEach((row) => table.put(names, row));
    // Times of control run ahead of the camera's: they make the table long enough first.
    put(batch.control, ["phase", ...axes("wanted"), ...both("estimated"), "wanted.vz"]);
    put(batch.position, [...both("measured"), "status"]);
    put(batch.truth, [...both("truth"), "attitude.w", "attitude.x", "attitude.y", "attitude.z"]);
    put(batch.outputs, sticks("asked"));
    put(batch.readback, [...sticks("read"), "faults"]);
    put(batch.tick, ["lateness", "took", "actuate", "overrun"]);
  }

  draw(seconds) {
    if (this.table.time.length === 0) return;
    const from = this.table.from(seconds);
    for (const plot of this.plots) plot.draw(this.table, from);
  }

  again() {
    for (const plot of this.plots) plot.again();
  }
}
