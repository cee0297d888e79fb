// The picture: chooses a back end, draws when something changed, and keeps the frame rate by the number of points.
import { Camera } from './camera.js';
import { Overlay, scaleClasses, yawOf } from './overlay.js';
import { RasterBackend } from './raster.js';
import { WebglBackend, webglRenderer, isSoftware } from './webgl.js';
import { pointTable, stateColours, runColours } from './palettes.js';
import { heightRange } from './clouds.js';

const kMovingFrame = 34;  // milliseconds wished for while something moves
const kClasses = 24;

export class Stage {
  constructor(elements, settings) {
    this.elements = elements;
    this.settings = settings;
    this.camera = new Camera();
    this.overlay = new Overlay(elements.ground, elements.lines);
    this.drives = [];
    this.scan = null;
    this.pose = null;
    this.shown = null;
    this.degenerate = 0;
    this.until = undefined;
    this.range = { low: 0, high: 1, time: 1, gain: 1 };
    this.budget = 400000;
    this.dirty = true;
    this.movedAt = 0;
    this.frames = [];
    this.dark = true;
    this.errorRange = [0, 1];
    this.speedRange = [0, 1];
    this.bottom = 0;
    this.chooseBackend(settings.renderer);
    new ResizeObserver(() => this.resize()).observe(elements.stage);
    this.resize();
    this.listen();
    this.tick = this.tick.bind(this);
    requestAnimationFrame(this.tick);
  }

  chooseBackend(wish) {
    const name = webglRenderer();
    const webgl = wish === 'webgl' ? name !== null : wish === 'processor' ? false : name !== null && !isSoftware(name);
    this.rendererName = name;
    try {
      this.backend = webgl ? new WebglBackend(this.elements.points) : new RasterBackend(this.elements.points);
    } catch {
      this.backend = new RasterBackend(this.elements.points);
    }
    if (webgl) {
      this.budget = 4e6;
      this.elements.points.addEventListener('webglcontextlost', (event) => event.preventDefault());
      this.elements.points.addEventListener('webglcontextrestored', () => {
        for (const cloud of this.clouds()) this.backend.forget(cloud);
        this.redraw();
      });
    }
  }

  * clouds() {
    for (const drive of this.drives) if (drive.visible !== false) yield* drive.tiles.values();
  }

  redraw() { this.dirty = true; }

  /** Points or their colouring have changed. */
  recolour() {
    const map = [...this.clouds()];
    const [low, high] = heightRange(map.length ? map : this.scan ? [this.scan] : []);
    this.range = { ...this.range, low, high };
    for (const cloud of map) cloud.colour(this.settings.colour, this.range);
    if (this.scan) this.scan.colour(this.settings.colour, this.range);
    this.redraw();
  }

  /** Colours a cloud that changed, and all of them once the heights have. */
  colourCloud(cloud) {
    cloud.colour(this.settings.colour, this.range);
    this.redraw();
  }

  setTheme(dark) {
    this.dark = dark;
    this.backend.setPalette(pointTable(this.settings.palette, dark));
    this.colours = dark
      ? { grid: '#31404b', gridStrong: '#43566433', text: '#9fb1bf', frustum: '#9fd4ff', vehicle: '#ffffff', vehicleSide: '#b9c8d4', vehicleShadow: '#000000aa', vehicleEdge: '#0a0f13', casing: 'rgba(4,8,11,.75)', truth: '#ffffff', warn: '#ff6a2b', scan: 0xffffffff }
      : { grid: '#c3ccd4', gridStrong: '#aab6c0', text: '#51616f', frustum: '#0072B2', vehicle: '#14202a', vehicleSide: '#3c4d5b', vehicleShadow: '#00000033', vehicleEdge: '#ffffff', casing: 'rgba(255,255,255,.85)', truth: '#555f68', warn: '#D55E00', scan: 0xff14202a };
    if (dark) this.colours.gridStrong = '#4a5f6e';
    this.redraw();
  }

  resize() {
    const box = this.elements.stage.getBoundingClientRect();
    const width = Math.max(2, Math.round(box.width)), height = Math.max(2, Math.round(box.height));
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    this.camera.resize(width, height);
    this.overlay.resize(width, height, ratio);
    this.backend.resize(width, height, ratio);
    if (this.colours) this.backend.setPalette(pointTable(this.settings.palette, this.dark));
    if (this.fitted) this.fit();
    this.redraw();
  }

  listen() {
    const canvas = this.elements.lines;
    const held = new Map();
    let spread = 0;
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      held.set(event.pointerId, [event.clientX, event.clientY]);
      spread = 0;
    });
    canvas.addEventListener('pointermove', (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const dx = event.clientX - before[0], dy = event.clientY - before[1];
      held.set(event.pointerId, [event.clientX, event.clientY]);
      if (held.size >= 2) {
        const [a, b] = [...held.values()];
        const now = Math.hypot(a[0] - b[0], a[1] - b[1]);
        if (spread > 0) this.camera.zoom(spread / Math.max(now, 1));
        spread = now;
        this.camera.pan(dx / 2, dy / 2);
      } else if (event.buttons & 2 || event.buttons & 4 || event.shiftKey || event.ctrlKey) {
        this.camera.pan(dx, dy);
      } else if (this.camera.mode === 'top') {
        this.camera.pan(dx, dy);
      } else {
        this.camera.rotate(dx, dy);
      }
      this.moved();
    });
    const release = (event) => held.delete(event.pointerId);
    canvas.addEventListener('pointerup', release);
    canvas.addEventListener('pointercancel', release);
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.camera.zoom(Math.exp(Math.min(Math.max(event.deltaY, -200), 200) * 0.0012));
      this.moved();
    }, { passive: false });
    canvas.addEventListener('dblclick', () => this.fit());
  }

  moved() {
    this.fitted = false;
    this.movedAt = performance.now();
    this.onMoved?.();
    this.redraw();
  }

  setMode(mode) {
    this.camera.setMode(mode);
    if (mode === 'follow' && this.pose) this.camera.follow(this.pose.position, yawOf(this.pose.orientation), 1);
    if (mode === 'orbit') this.fit();
    this.moved();
  }

  /** Shows all paths whole, clear of what lies over the picture. */
  fit() {
    const points = [];
    for (const drive of this.drives) {
      const step = 3 * Math.max(1, Math.floor(drive.path.count / 400));
      if (drive.visible !== false) for (let i = 0; i + 2 < 3 * drive.path.count; i += step) points.push(drive.path.xyz.slice(i, i + 3));
    }
    if (!points.length) return;
    const camera = this.camera;
    if (camera.mode === 'follow') camera.mode = 'orbit';
    camera.panned = true;
    if (camera.mode === 'orbit') camera.pitch = Math.max(camera.pitch, 0.6);
    const middle = [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);
    const radius = Math.max(...points.map((p) => Math.hypot(p[0] - middle[0], p[1] - middle[1])), 15);
    camera.target = middle;
    camera.distance = 3 * radius;
    const wide = camera.width - 2 * Math.min(70, camera.width * 0.08), top = 70, bottom = this.bottom + 40;
    const tall = Math.max(camera.height - top - bottom, 60);
    for (let round = 0; round < 8; ++round) {
      camera.update();
      const seen = points.map((p) => camera.project(p));
      const low = [0, 1].map((k) => Math.min(...seen.map((p) => p[k]))), high = [0, 1].map((k) => Math.max(...seen.map((p) => p[k])));
      const k = camera.distance / camera.focal;
      const dx = (low[0] + high[0] - camera.width) / 2, dy = (low[1] + high[1]) / 2 - (top + tall / 2);
      const rise = Math.max(Math.sin(camera.pitch), 0.3);
      const cy = Math.cos(camera.yaw), sy = Math.sin(camera.yaw);
      camera.target[0] += k * (dx * sy - (dy / rise) * cy);
      camera.target[1] += k * (-dx * cy - (dy / rise) * sy);
      const factor = Math.max((high[0] - low[0]) / wide, (high[1] - low[1]) / tall);
      camera.distance = Math.max(18, camera.distance * (1 + 0.8 * (factor - 1)));
    }
    this.moved();
    this.fitted = true;
  }

  setPose(pose, degenerate, smooth) {
    const first = !this.pose;
    this.pose = pose;
    this.degenerate = degenerate;
    if (first || !smooth) {
      this.shown = { position: [...pose.position], orientation: [...pose.orientation] };
      this.camera.follow(pose.position, yawOf(pose.orientation), first ? 1 : 0.25);
    }
    this.redraw();
  }

  /** Moves what is shown towards the newest pose, so that ten poses a second look continuous. */
  glide() {
    if (!this.pose || !this.shown) return;
    let rest = 0;
    const blend = 0.3;
    for (let i = 0; i < 3; ++i) {
      const step = this.pose.position[i] - this.shown.position[i];
      rest = Math.max(rest, Math.abs(step));
      this.shown.position[i] += Math.abs(step) > 20 ? step : blend * step;
    }
    const a = this.shown.orientation, b = this.pose.orientation;
    const sign = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] < 0 ? -1 : 1;
    let norm = 0;
    for (let i = 0; i < 4; ++i) {
      rest = Math.max(rest, 4 * Math.abs(sign * b[i] - a[i]));
      a[i] += blend * (sign * b[i] - a[i]);
      norm += a[i] * a[i];
    }
    for (let i = 0; i < 4; ++i) a[i] /= Math.sqrt(norm);
    const before = [...this.camera.target, this.camera.yaw];
    this.camera.follow(this.shown.position, yawOf(this.shown.orientation), 0.35);
    const turned = [...this.camera.target, this.camera.yaw].some((v, i) => Math.abs(v - before[i]) > 2e-3);
    if (rest > 5e-3 || turned) {
      this.movedAt = performance.now();
      this.dirty = true;
    }
  }

  tick(time) {
    requestAnimationFrame(this.tick);
    if (document.hidden) return;
    this.glide();
    // After motion, once more with all points.
    if (!this.dirty && this.reduced && performance.now() - this.movedAt > 250) this.dirty = true;
    if (!this.dirty || !this.colours) return;
    this.dirty = false;
    const begin = performance.now();
    this.draw(begin - this.movedAt < 200);
    const took = performance.now() - begin;
    this.frames.push([time, took]);
    while (this.frames.length > 120 || (this.frames.length && time - this.frames[0][0] > 4000)) this.frames.shift();
    if (this.reducing) this.adapt(took);
  }

  /** Fewer points when frames take too long, more when there is time. */
  adapt(took) {
    const gpu = this.backend instanceof WebglBackend;
    // What WebGL takes shows only in the distance of the frames.
    const last = this.frames.length > 1 ? this.frames[this.frames.length - 1][0] - this.frames[this.frames.length - 2][0] : took;
    const cost = gpu ? Math.min(last, 200) : took;
    if (cost > kMovingFrame * (gpu ? 1.7 : 0.9)) this.budget = Math.max(gpu ? 30000 : 80000, this.budget * 0.88);
    else if (cost < kMovingFrame * 0.6) this.budget = Math.min(6e6, this.budget * 1.04);
  }

  frameRate() {
    const f = this.frames;
    return f.length < 2 ? 0 : ((f.length - 1) * 1000) / (f[f.length - 1][0] - f[0][0]);
  }

  draw(moving) {
    const camera = this.camera;
    camera.update();
    this.overlay.clear();
    const items = [];
    let total = 0;
    for (const drive of this.drives) {
      if (drive.visible === false) continue;
      for (const cloud of drive.tiles.values()) {
        if (cloud.count === 0 || !this.inSight(cloud)) continue;
        items.push({ cloud, colour: this.settings.colour === 'run' ? drive.pointColour : undefined, distance: this.distance(cloud) });
        total += cloud.count;
      }
    }
    this.reducing = moving;
    const limit = moving ? this.budget : Math.max(this.budget, 3e6);
    this.reduced = moving && total > limit;
    // Near tiles keep more of their points.
    const weight = (item) => item.cloud.count / Math.max(1, item.distance / (2 * camera.distance)) ** 1.5;
    const sum = items.reduce((s, item) => s + weight(item), 0);
    this.drawn = 0;
    for (const item of items) {
      item.count = total <= limit ? item.cloud.count : Math.min(item.cloud.count, Math.ceil((limit * weight(item)) / sum));
      this.drawn += item.count;
    }
    items.sort((a, b) => a.distance - b.distance);
    if (this.scan && this.settings.showScan && this.scan.count) items.push({ cloud: this.scan, count: this.scan.count, colour: this.colours.scan });
    this.backend.draw(camera, items, { size: this.settings.size, shading: this.settings.shading });
    this.drawLines();
  }

  distance(cloud) {
    let sum = 0;
    for (let i = 0; i < 3; ++i) {
      const nearest = Math.min(Math.max(this.camera.eye[i], cloud.low[i]), cloud.high[i]);
      sum += (nearest - this.camera.eye[i]) ** 2;
    }
    return Math.sqrt(sum);
  }

  inSight(cloud) {
    const c = this.camera;
    let radius = 0;
    const middle = [0, 1, 2].map((i) => (cloud.low[i] + cloud.high[i]) / 2);
    for (let i = 0; i < 3; ++i) radius += ((cloud.high[i] - cloud.low[i]) / 2) ** 2;
    radius = Math.sqrt(radius);
    const d = [0, 1, 2].map((i) => middle[i] - c.eye[i]);
    const depth = d[0] * c.forward[0] + d[1] * c.forward[1] + d[2] * c.forward[2];
    if (depth < -radius) return false;
    const side = Math.abs(d[0] * c.right[0] + d[1] * c.right[1]);
    const rise = Math.abs(d[0] * c.up[0] + d[1] * c.up[1] + d[2] * c.up[2]);
    const tan = c.height / 2 / c.focal, wide = tan * (c.width / c.height);
    return side <= depth * wide + radius * Math.hypot(1, wide) && rise <= depth * tan + radius * Math.hypot(1, tan);
  }

  drawLines() {
    const { camera, overlay, settings, colours } = this;
    const theme = this.dark ? 'dark' : 'light';
    const ground = this.pose ? this.pose.position[2] : 0;
    if (settings.grid) overlay.grid(camera, this.groundHeight ?? ground, colours);
    const scale = scaleClasses(settings.pathColour === 'error' ? 'cividis' : 'viridis', kClasses, this.dark);
    const bin = (value, [low, high]) => Math.min(kClasses - 1, Math.max(0, Math.floor(((value - low) / Math.max(high - low, 1e-9)) * kClasses)));
    this.drives.forEach((drive, index) => {
      if (drive.visible === false) return;
      const path = drive.path;
      if (drive.truth && settings.showTruth)
        overlay.path(camera, drive.truth, () => 0, [colours.truth], { width: 1.6, dash: [7, 5] });
      let classOf = () => 0;
      let classes = [runColours[theme][index % runColours[theme].length]];
      if (settings.pathColour === 'state' && path.state) {
        classOf = (i) => path.state[i];
        classes = stateColours[theme];
      } else if (settings.pathColour === 'speed' && path.speed) {
        classOf = (i) => bin(path.speed[i], this.speedRange);
        classes = scale;
      } else if (settings.pathColour === 'error' && path.error) {
        classOf = (i) => (path.error[i] > this.errorRange[1] ? kClasses : bin(path.error[i], this.errorRange));
        classes = [...scale, colours.warn];
      }
      overlay.path(camera, path, classOf, classes, { width: 3.2, casing: colours.casing, until: index === this.selected || this.drives.length === 1 ? this.until : undefined });
    });
    if (this.shown && settings.showVehicle) {
      overlay.degenerate(camera, this.shown, this.degenerate, colours.warn);
      overlay.vehicle(camera, this.shown, colours);
    }
    overlay.compass(camera, colours, this.bottom + (window.innerWidth <= 820 ? 52 : 0));
  }

  /** The picture as a PNG. */
  async png() {
    this.draw(false);
    const { ground, points, lines, stage } = this.elements;
    const canvas = document.createElement('canvas');
    canvas.width = lines.width;
    canvas.height = lines.height;
    const context = canvas.getContext('2d');
    context.fillStyle = getComputedStyle(stage).backgroundColor;
    context.fillRect(0, 0, canvas.width, canvas.height);
    for (const layer of [ground, points, lines]) context.drawImage(layer, 0, 0, canvas.width, canvas.height);
    return new Promise((done) => canvas.toBlob(done, 'image/png'));
  }
}
