// Cards of a live drive: state, latency, compute, input, IMU, events.
import { Chart } from './charts.js';
import { card, clock, count, duration, element, figure, number, pairs, table, text, words } from './ui.js';
import { levels, levelColours, states } from './palettes.js';

const column = { scan: 0, time: 1, state: 2, level: 3, endToEnd: 4, written: 5, here: 6, queue: 7, filter: 8, coarse: 9, fine: 10, used: 11, lost: 12, overshoot: 13, speed: 14, points: 15 };
const kSpan = 60;

/** Names of stages for people; the order is that of the scan's way. */
export const stageNames = {
  receive_to_pop: 'pick up packets', assemble: 'assemble scan', queue: 'wait in queue', filter: 'filter, deskew', coarse: 'NDT', fine: 'ICP', deliver: 'deliver',
  pick_up: 'to publisher', write: 'DDS write', map: 'map update', end_to_end: 'last packet → pose', received_to_written: 'last packet → DDS written',
  imu_pick_up: 'IMU to publisher', imu_write: 'IMU DDS write', imu_received_to_written: 'IMU sample → DDS written',
};
export const imuChecks = ['gyro_agreement', 'gyro_axes', 'gyro_mounting', 'gyro_scale', 'gyro_bias', 'gyro_noise', 'gyro_saturation', 'gyro_stuck', 'gravity_magnitude', 'gravity_direction', 'accel_mounting', 'accel_vibration', 'accel_saturation', 'accel_stuck', 'time_offset', 'sample_loss', 'sample_gap'];
const short = (ms) => (ms >= 1 && ms < 1000 ? `${ms.toFixed(1)} ms` : duration(ms));
const stateMarks = { tracking: '●', degraded: '▲', lost: '✕', initialising: '◌' };

export class LivePanels {
  constructor(root, theme) {
    this.theme = theme;
    this.eventsSeen = 0;
    this.state();
    this.latency();
    this.compute();
    this.input();
    this.imu();
    this.events();
    root.replaceChildren(this.stateCard.made, this.latencyCard.made, this.computeCard.made, this.inputCard.made, this.imuCard.made, this.eventCard.made);
  }

  state() {
    this.badge = element('div', { class: 'badge', 'data-state': 'none', role: 'status', 'aria-live': 'polite' }, 'waiting');
    this.figures = {
      speed: figure('m/s', 'Speed over ground'), rate: figure('poses/s', 'Rate of the last five seconds'),
      distance: figure('m driven', 'Length of the path since this view knows the drive'), age: figure('s old', 'Age of the newest pose at the server'),
    };
    this.where = element('div', { class: 'where' });
    this.stateCard = card('State', this.badge, element('div', { class: 'figures' }, Object.values(this.figures).map((f) => f.made)), this.where);
  }

  latency() {
    this.p50 = figure('p50', 'Median from the last packet to the return of write(), since nilio-publisher started');
    this.p99 = figure('p99', '99 % of the scans are faster, since nilio-publisher started');
    this.max = figure('max', 'Slowest since nilio-publisher started');
    this.budget = figure('budget', 'Time from the last packet to the deadline');
    this.chart = new Chart('last packet → DDS written', [
      { label: 'latency', colour: '--accent', fill: true }], { unit: 'ms', height: 110, limits: () => (this.budgetMs > 0 ? [[this.budgetMs, '--bad']] : []), xUnit: ' s' });
    this.stageBars = element('div', { class: 'stages' });
    this.latencyCard = card('Latency', element('div', { class: 'figures' }, [this.p50, this.p99, this.max, this.budget].map((f) => f.made)), this.chart.made, this.stageBars);
    this.latencyCard.aside.textContent = 'since the publisher started';
  }

  compute() {
    this.strip = element('canvas', { class: 'strip', height: 22, role: 'img', 'aria-label': 'Degradation levels of the last minute' });
    this.stripKey = element('div', { class: 'key' });
    this.late = figure('late', 'Poses after their deadline, initialisation excluded');
    this.skipped = figure('skipped', 'Scans skipped for newer ones');
    this.guarded = figure('guarded', 'Predictions published because the registration was late');
    this.ratio = figure('of real time', 'Processing time over the duration of a scan');
    this.computeCard = card('Compute', element('div', { class: 'figures' }, [this.late, this.skipped, this.guarded, this.ratio].map((f) => f.made)), this.strip, this.stripKey);
    this.computeCard.aside.textContent = 'last minute';
  }

  input() {
    this.lost = figure('packets lost', 'LiDAR packets lost since this view started');
    this.dropped = figure('poses lost', 'Poses lost between publisher and this view, and in the rings');
    this.points = figure('points', 'Points of the newest scan');
    this.source = element('div', { class: 'note-line' });
    this.diagnostics = element('div', { class: 'diagnostics' });
    this.inputCard = card('LiDAR and DDS', element('div', { class: 'figures' }, [this.points, this.lost, this.dropped].map((f) => f.made)), this.source, this.diagnostics);
  }

  imu() {
    this.imuUse = element('div', { class: 'note-line' }, 'no IMU reported');
    this.imuList = element('div', { class: 'checks' });
    this.imuCard = card('IMU', this.imuUse, this.imuList);
  }

  events() {
    this.eventList = element('ol', { class: 'events', 'aria-live': 'off' });
    this.eventCard = card('Events', this.eventList);
  }

  update(message) {
    const scan = message.scan, pose = message.pose;
    const alive = message.alive;
    const state = !alive ? (pose ? 'silent' : 'none') : scan?.state ?? 'none';
    if (this.badge.dataset.state !== state) {
      this.badge.dataset.state = state;
      this.badge.setAttribute('aria-live', state === 'lost' ? 'assertive' : 'polite');
    }
    text(this.badge, state === 'none' ? 'waiting for poses' : state === 'silent' ? '✕ no poses' : `${stateMarks[state] ?? ''} ${state}`);
    this.stateCard.aside.textContent = scan && alive ? `${words(scan.stop_reason)}${scan.predicted ? ', predicted' : ''}` : '';
    const speed = pose ? Math.hypot(...pose.linear_velocity) : null;
    this.figures.speed.set(number(speed, 1));
    this.figures.rate.set(number(message.rate_hz, 1));
    this.figures.distance.set(message.path_length_m < 9999.5 ? number(message.path_length_m, 1) : number(message.path_length_m, 0));
    this.figures.age.set(message.age_s < 0 ? '–' : number(message.age_s, message.age_s < 10 ? 2 : 0), alive ? '' : 'bad');
    text(this.where, pose ? `x ${number(pose.position[0])}  y ${number(pose.position[1])}  z ${number(pose.position[2])} m   σ ${number(pose.sigma_m, 3)} m` : '');
    if (message.budget_ms > 0) this.budgetMs = message.budget_ms;
    this.budget.set(message.budget_ms > 0 ? duration(message.budget_ms) : 'none');
    this.points.set(scan ? count(scan.points) : '–');
    this.lostPoses = message.lost;
  }

  rows(rows) {
    if (!rows.length) return;
    const last = rows[rows.length - 1][column.time];
    const recent = rows.filter((row) => row[column.time] >= last - kSpan);
    this.chart.update([recent.map((r) => r[column.time]), recent.map((r) => (r[column.written] >= 0 ? r[column.written] : null))]);
    this.drawStrip(recent, last);
  }

  drawStrip(rows, last) {
    const canvas = this.strip;
    const width = canvas.clientWidth * devicePixelRatio;
    if (!width) return;
    canvas.width = width;
    canvas.height = 22 * devicePixelRatio;
    const context = canvas.getContext('2d');
    const colours = levelColours[this.theme()];
    const counts = new Map();
    rows.forEach((row, i) => {
      const x = ((row[column.time] - last + kSpan) / kSpan) * width;
      const next = i + 1 < rows.length ? ((rows[i + 1][column.time] - last + kSpan) / kSpan) * width : width;
      context.fillStyle = colours[row[column.level]] ?? '#888';
      // Lower for less work, so that the level does not show by colour alone.
      const level = row[column.level];
      const height = canvas.height * (1 - 0.19 * level);
      context.fillRect(x, canvas.height - height, Math.max(next - x, 1), height);
      counts.set(level, (counts.get(level) ?? 0) + 1);
    });
    const key = [...counts].sort((a, b) => a[0] - b[0]).map(([level, n]) => {
      const dot = element('i', {});
      dot.style.background = colours[level];
      return element('span', {}, dot, `${words(levels[level])} `, element('b', {}, `${((100 * n) / rows.length).toFixed(n === rows.length ? 0 : 1)} %`));
    });
    this.stripKey.replaceChildren(...key);
  }

  summary(message) {
    const stages = new Map((message.stages ?? []).map((s) => [s.name, s]));
    const whole = stages.get('received_to_written');
    if (whole) {
      this.p50.set(short(whole.p50_us / 1000));
      this.p99.set(short(whole.p99_us / 1000), this.budgetMs > 0 && whole.p99_us / 1000 > this.budgetMs ? 'bad' : '');
      this.max.set(short(whole.max_us / 1000));
    }
    this.showStages(stages, message);
    const c = message.counts;
    this.late.set(count(c.late), c.late > 0 ? 'warn' : '');
    this.skipped.set(count(c.superseded), c.superseded > 0 ? 'warn' : '');
    this.guarded.set(count(c.guarded), c.guarded > 0 ? 'warn' : '');
    this.ratio.set(`${(100 * message.real_time_ratio).toFixed(0)} %`, message.real_time_ratio > 0.8 ? 'bad' : '');
    this.lost.set(count(c.lost_packets), c.lost_packets > 0 ? 'warn' : '');
    const poses = (this.lostPoses ?? 0) + c.queue_dropped + (message.published?.ring_dropped ?? 0);
    this.dropped.set(count(poses), poses > 0 ? 'warn' : '');
    this.showDiagnostics(message.diagnostics ?? []);
  }

  showStages(stages, message) {
    const order = ['receive_to_pop', 'assemble', 'queue', 'filter', 'coarse', 'fine', 'deliver', 'pick_up', 'write'];
    const list = order.filter((name) => stages.get(name)?.count > 0).map((name) => [name, stages.get(name)]);
    const longest = Math.max(1e-9, ...list.map(([, s]) => s.p99_us));
    const row = (name, s) => {
      const bar = element('div', { class: 'bar' });
      const p99 = element('i', { class: 'p99' }), p50 = element('i', { class: 'p50' });
      p99.style.width = `${(100 * s.p99_us) / longest}%`;
      p50.style.width = `${(100 * s.p50_us) / longest}%`;
      bar.append(p99, p50);
      return [stageNames[name] ?? words(name), bar, duration(s.p50_us / 1000), duration(s.p99_us / 1000), duration(s.max_us / 1000)];
    };
    const rows = list.map(([name, s]) => row(name, s));
    const plain = (title, s) => [title, '', duration(s.p50_us / 1000), duration(s.p99_us / 1000), duration(s.max_us / 1000)];
    if (message.here?.count > 0) rows.push(plain('last packet → this view', message.here));
    const imu = stages.get('imu_received_to_written');
    if (imu?.count > 0) rows.push(plain('IMU sample → DDS written', imu));
    this.stageBars.replaceChildren(rows.length ? table(['stage', '', 'p50', 'p99', 'max'], rows, { class: 'stage-table' }) : element('p', { class: 'muted' }, 'no latency report yet'));
  }

  showDiagnostics(groups) {
    const of = (group, key) => groups.find((g) => g.name === `nilio: ${group}`)?.values.find(([k]) => k === key)?.[1];
    const source = of('LiDAR', 'time source');
    const shift = of('IMU', 'time shift subtracted from its stamps, ms');
    const offset = of('IMU', 'time_offset');
    this.source.replaceChildren(
      element('span', {}, 'LiDAR time ', element('b', {}, source ? words(source) : '–')),
      ...(offset || shift ? [element('span', {}, 'IMU offset ', element('b', {}, (offset ?? '–').replace(/, ok$/, '')), shift ? ` (${shift} ms subtracted)` : '')] : []));
    const problems = groups.filter((g) => g.level > 0 && g.name !== 'nilio: IMU');
    this.diagnostics.replaceChildren(...problems.map((g) => element('p', { class: 'problem', 'data-tone': g.level > 1 ? 'bad' : 'warn' },
      element('b', {}, g.name.replace('nilio: ', '')), ` ${g.message}`)));
    const imu = groups.find((g) => g.name === 'nilio: IMU');
    if (!imu) return;
    const values = new Map(imu.values);
    this.imuUse.replaceChildren(element('b', { class: `tone-${['ok', 'warn', 'bad', 'bad'][imu.level] ?? 'bad'}` }, values.get('use') ?? imu.message));
    this.imuCard.aside.textContent = `${imuChecks.filter((name) => values.get(name)?.endsWith('ok')).length} of ${imuChecks.length} checks ok`;
    const chips = imuChecks.filter((name) => values.has(name)).map((name) => {
      const value = values.get(name);
      const state = /bad$/.test(value) ? 'bad' : /warn$/.test(value) ? 'warn' : /ok$/.test(value) ? 'ok' : 'unknown';
      return element('span', { class: 'check', 'data-tone': state, title: `${words(name)}: ${value}` },
        { ok: '✓', warn: '▲', bad: '✕', unknown: '·' }[state], ' ', words(name), state === 'unknown' ? '' : element('small', {}, value.replace(/, \w+$/, '')));
    });
    this.imuList.replaceChildren(...chips, ...(imu.level > 0 ? [element('p', { class: 'problem', 'data-tone': imu.level > 1 ? 'bad' : 'warn' }, imu.message)] : []));
  }

  addEvents(events) {
    for (const event of events) {
      const time = new Date(event.unix_s * 1000).toTimeString().slice(0, 8);
      this.eventList.prepend(element('li', { 'data-level': event.level }, element('time', {}, time), element('span', {}, { error: '✕ ', warning: '▲ ', info: '' }[event.level] ?? '', event.text)));
    }
    while (this.eventList.children.length > 200) this.eventList.lastChild.remove();
    this.eventCard.aside.textContent = `${this.eventList.children.length}`;
  }

  clearEvents() { this.eventList.replaceChildren(); }
}
