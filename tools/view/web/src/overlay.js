// Lines over and under the points: ground grid, paths, vehicle, directions that are not observed, scale.
import { css, colourAt } from './palettes.js';

const kCase = 2.5;

function cut(a, b, near) {
  // The end behind the camera moves onto the near plane.
  const k = (near - a[2]) / (b[2] - a[2]);
  return k;
}

export class Overlay {
  constructor(ground, lines) {
    this.ground = ground.getContext('2d');
    this.lines = lines.getContext('2d');
  }

  resize(width, height, ratio) {
    for (const context of [this.ground, this.lines]) {
      context.canvas.width = Math.round(width * ratio);
      context.canvas.height = Math.round(height * ratio);
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
    }
    this.width = width;
    this.height = height;
  }

  clear() {
    this.ground.clearRect(0, 0, this.width, this.height);
    this.lines.clearRect(0, 0, this.width, this.height);
  }

  /** Segment between world points, cut at the near plane; adds to the current path of the context. */
  segment(context, camera, a, b) {
    let from = camera.project(a), to = camera.project(b);
    if (from[2] < camera.near && to[2] < camera.near) return;
    if (from[2] < camera.near || to[2] < camera.near) {
      const k = cut(from, to, camera.near);
      const middle = camera.project([0, 1, 2].map((i) => a[i] + k * (b[i] - a[i])));
      if (from[2] < camera.near) from = middle; else to = middle;
    }
    context.moveTo(from[0], from[1]);
    context.lineTo(to[0], to[1]);
  }

  grid(camera, height, colours) {
    const steps = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000];
    const step = steps.find((s) => s > camera.distance / 9) ?? 1000;
    const reach = 16;
    const [tx, ty] = [0, 1].map((i) => Math.round(camera.target[i] / step));
    const context = this.ground;
    context.lineWidth = 1;
    for (let i = -reach; i <= reach; ++i) {
      const fade = 1 - Math.abs(i) / (reach + 1);
      for (const axis of [0, 1]) {
        const index = (axis === 0 ? tx : ty) + i;
        context.strokeStyle = index % 5 === 0 ? colours.gridStrong : colours.grid;
        const along = (axis === 0 ? ty : tx) * step;
        const across = index * step;
        // Parts of each line fade with their distance.
        for (let part = -reach; part < reach; part += 4) {
          context.globalAlpha = fade * (1 - Math.abs(part + 2) / (reach + 2));
          const a = along + part * step, b = along + (part + 4) * step;
          context.beginPath();
          this.segment(context, camera, axis === 0 ? [across, a, height] : [a, across, height],
            axis === 0 ? [across, b, height] : [b, across, height]);
          context.stroke();
        }
      }
    }
    context.globalAlpha = 1;
    return step;
  }

  /**
   * A path: `path.xyz` (3 a vertex), coloured per vertex by `classOf(i)`, an index into `classes` (colours).
   * Vertices after `until` are faint.
   */
  path(camera, path, classOf, classes, options) {
    const { xyz, count } = path;
    if (count < 2) return;
    const context = this.lines;
    const until = options.until ?? count;
    context.lineJoin = context.lineCap = 'round';
    const runs = [];
    let run = null, last = null;
    let lastClass = -1, lastFaint = false;
    const stride = Math.max(1, Math.floor(count / 12000));
    const point = [0, 0, 0];
    for (let i = 0; i < count; i += stride) {
      point[0] = xyz[3 * i]; point[1] = xyz[3 * i + 1]; point[2] = xyz[3 * i + 2];
      const p = camera.project(point);
      if (p[2] < camera.near) { run = null; last = null; continue; }
      const of = classOf(i), faint = i > until;
      if (!run || of !== lastClass || faint !== lastFaint) {
        run = { of, faint, points: last ? [last] : [] };
        runs.push(run);
        lastClass = of;
        lastFaint = faint;
      }
      if (!last || Math.abs(p[0] - last[0]) + Math.abs(p[1] - last[1]) > 0.8 || run.points.length < 2) {
        run.points.push(p);
        last = p;
      }
    }
    const draw = (style, width, faintOnly) => {
      for (const r of runs) {
        if (r.points.length < 2 || (faintOnly !== undefined && r.faint !== faintOnly)) continue;
        context.globalAlpha = r.faint ? 0.28 : 1;
        context.strokeStyle = style ?? classes[r.of];
        context.lineWidth = width;
        if (options.dash) context.setLineDash(options.dash);
        context.beginPath();
        r.points.forEach((p, i) => (i ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1])));
        context.stroke();
      }
      context.setLineDash([]);
      context.globalAlpha = 1;
    };
    if (options.casing) draw(options.casing, options.width + kCase, false);
    draw(undefined, options.width);
  }

  polygon(context, camera, points, fill, stroke, width = 1.5) {
    const seen = points.map((p) => camera.project(p));
    if (seen.some((p) => p[2] < camera.near)) return;
    context.beginPath();
    seen.forEach((p, i) => (i ? context.lineTo(p[0], p[1]) : context.moveTo(p[0], p[1])));
    context.closePath();
    if (fill) { context.fillStyle = fill; context.fill(); }
    if (stroke) { context.strokeStyle = stroke; context.lineWidth = width; context.stroke(); }
  }

  /** The vehicle as an arrow on the ground with the cone that its sensor sees, at least `least` pixels long. */
  vehicle(camera, pose, colours) {
    const r = rotation(pose.orientation);
    const place = pose.position;
    const centre = camera.project(place);
    if (centre[2] < camera.near) return;
    const pixels = camera.focal / centre[2];
    const size = Math.max(4.4, 26 / pixels);
    const at = (x, y, z) => [0, 1, 2].map((i) => place[i] + r[i][0] * x + r[i][1] * y + r[i][2] * z);
    const context = this.lines;
    // Field of view: rings of the sensor's upper and lower beams.
    const ring = (radius, height, dash) => {
      context.setLineDash(dash);
      context.beginPath();
      const n = 48;
      for (let i = 0; i < n; ++i) {
        const a = (2 * Math.PI * i) / n, b = (2 * Math.PI * (i + 1)) / n;
        this.segment(context, camera, at(radius * Math.cos(a), radius * Math.sin(a), height), at(radius * Math.cos(b), radius * Math.sin(b), height));
      }
      context.stroke();
      context.setLineDash([]);
    };
    const sensor = 0.42 * size;
    const radius = 2.6 * size;
    context.strokeStyle = colours.frustum;
    context.lineWidth = 1.2;
    ring(radius, sensor + radius * 0.27, [4, 5]);
    ring(radius, sensor - radius * 0.16, [4, 5]);
    context.beginPath();
    for (let i = 0; i < 8; ++i) {
      const a = (Math.PI * (i + 0.5)) / 4;
      for (const slope of [0.27, -0.16])
        this.segment(context, camera, at(0, 0, sensor), at(radius * Math.cos(a), radius * Math.sin(a), sensor + radius * slope));
    }
    context.globalAlpha = 0.35;
    context.stroke();
    context.globalAlpha = 1;
    // Body: a wedge with its nose ahead.
    const l = size / 2, w = size * 0.21, h = size * 0.2;
    const low = [at(l, 0, 0), at(l * 0.35, w, 0), at(-l, w, 0), at(-l * 0.72, 0, 0), at(-l, -w, 0), at(l * 0.35, -w, 0)];
    const high = [at(l * 0.62, 0, h), at(l * 0.25, w * 0.72, h), at(-l * 0.8, w * 0.72, h), at(-l * 0.6, 0, h), at(-l * 0.8, -w * 0.72, h), at(l * 0.25, -w * 0.72, h)];
    this.polygon(context, camera, low, colours.vehicleShadow, null);
    for (let i = 0; i < low.length; ++i) {
      const j = (i + 1) % low.length;
      this.polygon(context, camera, [low[i], low[j], high[j], high[i]], colours.vehicleSide, null);
    }
    this.polygon(context, camera, high, colours.vehicle, colours.vehicleEdge, 1.5);
  }

  /** Double arrows along axes of base_link that the scan does not observe, arcs for rotations. */
  degenerate(camera, pose, bits, colour) {
    if (!bits) return;
    const r = rotation(pose.orientation);
    const p = pose.position;
    const depth = Math.max(camera.project(p)[2], camera.near);
    const length = Math.max(7, (90 * depth) / camera.focal);
    const context = this.lines;
    context.strokeStyle = context.fillStyle = colour;
    context.lineWidth = 3;
    for (let axis = 0; axis < 3; ++axis) {
      const direction = [0, 1, 2].map((i) => r[i][axis]);
      const end = (k) => [0, 1, 2].map((i) => p[i] + direction[i] * k + (i === 2 ? 1.2 : 0));
      if (bits & (1 << axis)) {
        context.beginPath();
        this.segment(context, camera, end(-length), end(length));
        context.stroke();
        for (const k of [-length, length]) {
          const tip = camera.project(end(k)), back = camera.project(end(k * 0.86));
          if (tip[2] < camera.near || back[2] < camera.near) continue;
          const dx = tip[0] - back[0], dy = tip[1] - back[1];
          context.beginPath();
          context.moveTo(tip[0], tip[1]);
          context.lineTo(back[0] - dy * 0.5, back[1] + dx * 0.5);
          context.lineTo(back[0] + dy * 0.5, back[1] - dx * 0.5);
          context.fill();
        }
      }
      if (bits & (8 << axis)) {
        const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        const around = (a) => [0, 1, 2].map((i) => p[i] + 0.6 * length * (Math.cos(a) * r[i][u] + Math.sin(a) * r[i][v]) + (i === 2 ? 1.2 : 0));
        context.beginPath();
        for (let i = 0; i < 24; ++i) this.segment(context, camera, around(i * 0.2), around((i + 1) * 0.2));
        context.stroke();
      }
    }
  }

  /** Axes of the world and a bar of a round length. */
  compass(camera, colours, bottom) {
    const context = this.lines;
    const x = 34, y = this.height - bottom - 34;
    const axes = [['x', camera.right[0], camera.up[0], '#e8603c'], ['y', camera.right[1], camera.up[1], '#3fb27f'], ['z', 0, camera.up[2], '#4f9be8']];
    context.lineWidth = 2;
    context.font = '600 10px system-ui, sans-serif';
    context.textAlign = 'center';
    context.textBaseline = 'middle';
    for (const [name, right, up, colour] of axes) {
      context.strokeStyle = context.fillStyle = colour;
      context.beginPath();
      context.moveTo(x, y);
      context.lineTo(x + 20 * right, y - 20 * up);
      context.stroke();
      context.fillText(name, x + 28 * right, y - 28 * up);
    }
    const metres = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000].find((m) => (m * camera.focal) / camera.distance > 56) ?? 5000;
    const length = (metres * camera.focal) / camera.distance;
    context.strokeStyle = colours.text;
    context.fillStyle = colours.text;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(76, y + 14);
    context.lineTo(76, y + 19);
    context.lineTo(76 + length, y + 19);
    context.lineTo(76 + length, y + 14);
    context.stroke();
    context.textAlign = 'left';
    context.fillText(metres >= 1000 ? `${metres / 1000} km` : `${metres} m`, 76, y + 5);
  }
}

export function rotation([x, y, z, w]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
  ];
}

export const yawOf = ([x, y, z, w]) => Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z));

/** Colours of a scale in so many steps. */
export const scaleClasses = (palette, n, dark) =>
  Array.from({ length: n }, (_, i) => css(colourAt(palette, dark ? 0.1 + (0.9 * i) / (n - 1) : (0.85 * i) / (n - 1))));
