// The time of a finished run: play, scrub, speed; below the handle the states, above it the speed.
import { clock, element } from './ui.js';
import { stateColours } from './palettes.js';

const speeds = [0.5, 1, 2, 5, 10, 20];

export class Timeline {
  constructor(root, theme, onTime) {
    this.root = root;
    this.theme = theme;
    this.onTime = onTime;
    this.time = 0;
    this.rate = 5;
    this.playing = false;
    this.button = element('button', { class: 'play', 'aria-label': 'Play or pause', title: 'Play or pause (space)', onclick: () => this.toggle() });
    this.strip = element('canvas', { 'aria-hidden': true });
    this.slider = element('input', { type: 'range', min: 0, max: 1, step: 0.05, 'aria-label': 'Time of the run in seconds', oninput: () => { this.set(Number(this.slider.value)); } });
    this.label = element('output', { class: 'clock' });
    this.select = element('select', { 'aria-label': 'Playing speed', title: 'Playing speed', onchange: () => { this.rate = Number(this.select.value); } },
      speeds.map((s) => element('option', { value: s, selected: s === this.rate }, `${s}×`)));
    root.replaceChildren(this.button, element('div', { class: 'track' }, this.strip, this.slider), this.label, this.select);
    root.hidden = false;
    new ResizeObserver(() => this.drawStrip()).observe(this.strip);
    this.showButton();
  }

  setDrive(drive) {
    this.drive = drive;
    this.duration = drive.duration;
    this.slider.max = this.duration;
    this.set(Math.min(this.time || this.duration, this.duration));
    this.drawStrip();
  }

  set(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.slider.value = this.time;
    this.slider.setAttribute('aria-valuetext', clock(this.time));
    this.label.textContent = `${clock(this.time)} / ${clock(this.duration)}`;
    this.onTime(this.time);
  }

  step(seconds) { this.set(this.time + seconds); }

  showButton() { this.button.textContent = this.playing ? '❚❚' : '▶'; }

  toggle() {
    this.playing = !this.playing;
    if (this.playing && this.time >= this.duration - 0.05) this.set(0);
    this.showButton();
    this.last = performance.now();
    if (this.playing) requestAnimationFrame(() => this.advance());
  }

  advance() {
    if (!this.playing) return;
    const now = performance.now();
    this.set(this.time + ((now - this.last) / 1000) * this.rate);
    this.last = now;
    if (this.time >= this.duration) { this.playing = false; this.showButton(); return; }
    requestAnimationFrame(() => this.advance());
  }

  drawStrip() {
    const { strip, drive } = this;
    const width = Math.round(strip.clientWidth * devicePixelRatio), height = Math.round(strip.clientHeight * devicePixelRatio);
    if (!drive || !width) return;
    strip.width = width;
    strip.height = height;
    const context = strip.getContext('2d');
    const { time, state, speed, count } = drive.path;
    let most = 1;
    for (let i = 0; i < count; ++i) most = Math.max(most, speed[i]);
    const colours = stateColours[this.theme()];
    const bar = 3 * devicePixelRatio;
    for (let x = 0, i = 0; x < width; ++x) {
      const t = (x / width) * this.duration;
      while (i + 1 < count && time[i + 1] <= t) ++i;
      const colour = state ? colours[state[i]] : colours[1];
      const rise = (speed[i] / most) * (height - bar - 2);
      context.globalAlpha = 0.32;
      context.fillStyle = colour;
      context.fillRect(x, height - bar - rise, 1, rise);
      context.globalAlpha = 1;
      context.fillRect(x, height - bar, 1, bar);
    }
  }
}
