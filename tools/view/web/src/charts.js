// Charts over time: uPlot with the colours of the theme, one cursor for all, and a mark at the moment shown.
import uPlot from 'uplot';
import { element } from './ui.js';

const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const charts = new Set();
let seek = null;
let mark = null;

/** Called with seconds when the reader clicks into a chart. */
export function onSeek(callback) { seek = callback; }

export function setMark(time) {
  if (mark === time) return;
  mark = time;
  for (const chart of charts) chart.plot?.redraw(false, false);
}

export function restyleCharts() {
  for (const chart of charts) chart.rebuild();
}

/** Least and largest value of every pixel column, so that peaks stay. */
export function decimate(columns, most) {
  const n = columns[0].length;
  if (n <= 2 * most) return columns;
  const step = Math.ceil(n / most);
  const out = columns.map(() => []);
  for (let begin = 0; begin < n; begin += step) {
    const end = Math.min(n, begin + step);
    out[0].push(columns[0][begin], columns[0][end - 1]);
    for (let k = 1; k < columns.length; ++k) {
      let low = null, high = null;
      for (let i = begin; i < end; ++i) {
        const v = columns[k][i];
        if (v === null || v === undefined) continue;
        if (low === null || v < low) low = v;
        if (high === null || v > high) high = v;
      }
      out[k].push(low, high);
    }
  }
  return out;
}

/**
 * A chart: `series` are {label, colour, fill, dash, width, unit, digits}; colour is a name of a style variable
 * or a function. `update(columns)` sets the data: times first.
 */
export class Chart {
  constructor(title, series, options = {}) {
    this.series = series;
    this.options = { height: 120, unit: '', ...options };
    this.box = element('div', { class: 'chart' });
    this.newest = element('span', { class: 'newest' });
    this.made = element('figure', { class: 'chart-figure', role: 'group', 'aria-label': `${title}, chart` },
      element('figcaption', {}, element('span', {}, title), this.newest), this.box);
    this.columns = [[], ...series.map(() => [])];
    charts.add(this);
    this.observer = new ResizeObserver(() => this.fit());
    this.observer.observe(this.box);
  }

  colour(series) { return typeof series.colour === 'function' ? series.colour() : style(series.colour); }

  rebuild() {
    this.plot?.destroy();
    this.plot = null;
    this.fit();
  }

  fit() {
    const width = Math.floor(this.box.clientWidth);
    if (width < 40) return;
    if (this.plot) {
      if (this.plot.width !== width) this.plot.setSize({ width, height: this.options.height });
      return;
    }
    const muted = style('--muted'), grid = style('--grid');
    const font = '10.5px system-ui, sans-serif';
    const axis = { stroke: muted, font, grid: { stroke: grid, width: 1 }, ticks: { show: false } };
    const limits = this.options.limits;
    this.plot = new uPlot({
      width, height: this.options.height, padding: [8, 8, 0, 0], legend: { show: false },
      cursor: { sync: { key: 'time' }, y: false, points: { size: 6 }, drag: { x: false, y: false } },
      scales: {
        x: { time: false },
        y: { distr: this.options.log ? 3 : 1, range: this.options.range ?? ((_, low, high) => {
          if (low === null) return [0, 1];
          const zero = this.options.fromZero !== false;
          const top = Math.max(high, this.options.least ?? 0);
          const bottom = zero ? Math.min(0, low) : low;
          const room = 0.08 * (top - bottom || Math.abs(top) || 1);
          return this.options.log ? [low * 0.8, top * 1.25] : [zero && bottom === 0 ? 0 : bottom - room, top + room];
        }) },
      },
      axes: [
        { ...axis, size: 22, gap: 3, values: (_, ticks) => ticks.map((t) => `${+t.toFixed(2)}${this.options.xUnit ?? ' s'}`) },
        { ...axis, size: 40, gap: 4, values: (_, ticks) => ticks.map((t) => `${+t.toPrecision(4)}`) },
      ],
      series: [{}, ...this.series.map((s) => ({
        label: s.label, stroke: () => this.colour(s), width: s.width ?? 1.6, dash: s.dash,
        fill: s.fill ? () => `${this.colour(s)}2b` : undefined, points: { show: false }, spanGaps: false,
      }))],
      hooks: {
        draw: [(u) => this.drawMarks(u, limits)],
        setCursor: [(u) => this.showValues(u.cursor.idx)],
        ready: [(u) => u.over.addEventListener('click', () => {
          const at = u.cursor.left;
          if (seek && at >= 0) seek(u.posToVal(at, 'x'));
        })],
      },
    }, this.decimated(), this.box);
    this.showValues(null);
  }

  drawMarks(u, limits) {
    const context = u.ctx;
    context.save();
    const line = (horizontal, value, colour, dash) => {
      const at = Math.round(u.valToPos(value, horizontal ? 'y' : 'x', true));
      context.strokeStyle = colour;
      context.setLineDash(dash);
      context.lineWidth = devicePixelRatio;
      context.beginPath();
      if (horizontal) { context.moveTo(u.bbox.left, at); context.lineTo(u.bbox.left + u.bbox.width, at); }
      else { context.moveTo(at, u.bbox.top); context.lineTo(at, u.bbox.top + u.bbox.height); }
      context.stroke();
    };
    for (const [value, colour] of limits?.() ?? []) {
      if (value > u.scales.y.min && value < u.scales.y.max) line(true, value, style(colour), [5 * devicePixelRatio, 4 * devicePixelRatio]);
    }
    if (mark !== null && mark >= u.scales.x.min && mark <= u.scales.x.max) line(false, mark, style('--text'), []);
    context.restore();
  }

  showValues(index) {
    const last = this.shownColumns?.[0].length - 1;
    const i = index ?? last;
    const spans = this.series.map((s, k) => {
      const value = this.shownColumns?.[k + 1]?.[i];
      if (s.hidden) return null;
      const dot = element('i', {});
      dot.style.background = this.colour(s);
      const shown = value === null || value === undefined ? '–' : `${value.toFixed(s.digits ?? this.options.digits ?? 2)}`;
      return element('span', {}, dot, `${s.label} `, element('b', {}, shown));
    }).filter(Boolean);
    if (this.options.unit) spans.push(element('span', { class: 'unit' }, this.options.unit));
    this.newest.replaceChildren(...spans);
  }

  decimated() {
    this.shownColumns = decimate(this.columns, Math.max(200, this.box.clientWidth));
    return this.shownColumns;
  }

  update(columns) {
    this.columns = columns;
    if (!this.plot) { this.fit(); return; }
    this.plot.setData(this.decimated());
    if (this.plot.cursor.idx === null || this.plot.cursor.left < 0) this.showValues(null);
  }

  remove() {
    this.plot?.destroy();
    this.observer.disconnect();
    charts.delete(this);
  }
}
