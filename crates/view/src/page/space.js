"use strict";
// The airframe in space: a floor, the rig's limits, the way flown, the airframe and where it should be.

class Space {
  constructor(canvas, about) {
    this.canvas = canvas;
    this.about = about;
    this.turn = 0.7;
    this.tilt = 0.42;
    let held = null;
    canvas.addEventListener("pointerdown", (event) => {
      held = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!held) return;
      this.look((event.clientX - held[0]) * 0.01, (event.clientY - held[1]) * 0.01);
      held = [event.clientX, event.clientY];
    });
    canvas.addEventListener("pointerup", () => (held = null));
    canvas.addEventListener("pointercancel", () => (held = null));
    canvas.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-0.15, 0], ArrowRight: [0.15, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
      if (!by) return;
      event.preventDefault();
      this.look(...by);
    });
  }

  look(turn, tilt) {
    this.turn += turn;
    this.tilt = Math.min(1.45, Math.max(0.05, this.tilt + tilt));
    if (this.table) this.draw(this.table);
  }

  // World, m, to the canvas, px; from outside of the limits, looking at their middle.
  project([x, y, z]) {
    const { turn, tilt, away, scale, width, height, middle } = this;
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    const right = -s * x + c * y;
    const deep = c * x + s * y;
    const up = z - middle;
    const far = away - (deep * Math.cos(tilt) + up * Math.sin(tilt));
    const high = up * Math.cos(tilt) - deep * Math.sin(tilt);
    const size = (scale * away) / Math.max(far, 0.1);
    return [width / 2 + right * size, height / 2 - high * size];
  }

  path(points, colour, width = 1, dash = []) {
    const { pen } = this;
    pen.beginPath();
    points.forEach((point, i) => {
      const [x, y] = this.project(point);
      if (i === 0) pen.moveTo(x, y);
      else pen.lineTo(x, y);
    });
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    pen.stroke();
    pen.setLineDash([]);
  }

  ring(radius, z, colour, width, dash, [x, y] = [0, 0]) {
    const points = Array.from({ length: 49 }, (_, i) => {
      const angle = (i / 24) * Math.PI;
      return [x + radius * Math.cos(angle), y + radius * Math.sin(angle), z];
    });
    this.path(points, colour, width, dash);
  }

  draw(table) {
    this.table = table;
    const { canvas, about } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (width === 0) return;
    if (canvas.width !== Math.round(width * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const pen = (this.pen = canvas.getContext("2d"));
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const kind = table.columns.has("truth.z") ? "truth" : "estimated";
    const where = (name, at) => ["x", "y", "z"].map((axis) => table.last(`${name}.${axis}`, at));
    // What is flown fills the view; the limits are shown as far as they reach into it.
    const top = Math.min(about.ceiling_m, Math.max(0.8, 1.15 * (this.highest(table, kind) ?? 0)));
    this.middle = 0.45 * top;
    const radius = Math.min(about.radius_m, Math.max(0.6, top * 0.75));
    Object.assign(this, { width, height, away: 3.2 * Math.max(top, radius), scale: Math.min(width / (3 * radius), height / (1.35 * top + 0.9 * radius)) });
    const [grid, line, soft] = [css("--grid"), css("--line"), css("--soft")];
    for (let at = -1; at <= 1.001; at += 0.25) {
      const edge = radius;
      this.path([[at * edge, -edge, 0], [at * edge, edge, 0]], grid);
      this.path([[-edge, at * edge, 0], [edge, at * edge, 0]], grid);
    }
    this.ring(radius, 0, line, 1.5);
    for (const [axis, name] of [[[radius * 0.5, 0, 0], "x"], [[0, radius * 0.5, 0], "y"]]) {
      this.path([[0, 0, 0], axis], soft, 1.5);
      this.text(axis.map((value) => value * 1.12), name, soft);
    }
    const mast = [radius, -radius];
    this.path([[...mast, 0], [...mast, top]], line);
    for (let z = 0; z <= top + 1e-6; z += top > 1.2 ? 0.5 : 0.2) {
      this.path([[mast[0], mast[1], z], [mast[0] + 0.05, mast[1], z]], soft);
      this.text([mast[0] - 0.08, mast[1], z], z.toFixed(1), soft);
    }
    const wanted = where("wanted");
    const here = where(kind);
    if (here[2] === null) return;
    this.trail(table, kind);
    if (wanted[2] !== null) {
      this.ring(0.06, wanted[2], css("--wanted"), 1.5, [4, 3], wanted);
      this.path([[wanted[0], wanted[1], 0], wanted], css("--wanted"), 1, [2, 4]);
    }
    this.path([[here[0], here[1], 0], here], soft, 1);
    this.ring(0.02, 0, soft, 1, [], here);
    this.airframe(here, [..."wxyz"].map((part) => table.last(`attitude.${part}`) ?? (part === "w" ? 1 : 0)));
  }

  highest(table, kind) {
    const column = table.columns.get(`${kind}.z`) ?? [];
    let highest = null;
    for (let i = Math.max(0, column.length - 6000); i < column.length; i++) {
      if (column[i] !== null && (highest === null || column[i] > highest)) highest = column[i];
    }
    return highest;
  }

  trail(table, kind) {
    const [x, y, z] = ["x", "y", "z"].map((axis) => table.columns.get(`${kind}.${axis}`));
    const points = [];
    for (let i = table.from(12); i < z.length; i++) if (z[i] !== null && x[i] !== null) points.push([x[i], y[i], z[i]]);
    if (points.length > 1) this.path(points, css(kind === "truth" ? "--truth" : "--estimated"), 1.6);
  }

  // Four arms and rotors of a 5 cm airframe, drawn twice its size so that its attitude can be seen.
  airframe([x, y, z], [w, i, j, k]) {
    const turned = ([a, b, c]) => [
      x + a * (1 - 2 * (j * j + k * k)) + b * 2 * (i * j - k * w) + c * 2 * (i * k + j * w),
      y + a * 2 * (i * j + k * w) + b * (1 - 2 * (i * i + k * k)) + c * 2 * (j * k - i * w),
      z + a * 2 * (i * k - j * w) + b * 2 * (j * k + i * w) + c * (1 - 2 * (i * i + j * j)),
    ];
    const arm = 0.06;
    const ink = css("--text");
    const rotor = (a, b, colour) => {
      const points = Array.from({ length: 17 }, (_, n) => {
        const angle = (n / 8) * Math.PI;
        return turned([a + 0.032 * Math.cos(angle), b + 0.032 * Math.sin(angle), 0.01]);
      });
      this.path(points, colour, 1.6);
    };
    for (const [a, b] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) {
      this.path([turned([0, 0, 0]), turned([a * arm, b * arm, 0])], ink, 2);
      // The front rotors are red, as the marker that the camera looks for.
      rotor(a * arm, b * arm, a > 0 ? css("--stop") : ink);
    }
  }

  text(point, words, colour) {
    const [x, y] = this.project(point);
    this.pen.fillStyle = colour;
    this.pen.font = "11px system-ui, sans-serif";
    this.pen.textAlign = "center";
    this.pen.textBaseline = "middle";
    this.pen.fillText(words, x, y);
  }
}
