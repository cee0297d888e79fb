// Cards of finished runs: summary, errors, position and attitude, latency, IMU, events, configuration.
import { Chart } from './charts.js';
import { card, clock, count, duration, element, figure, number, pairs, table, words } from './ui.js';
import { imuChecks, stageNames } from './panels_live.js';
import { levels, runColours, states } from './palettes.js';

const processing = ['filter', 'coarse', 'fine', 'deliver', 'map'];
const wholeOrder = ['receive_to_pop', 'assemble', 'queue', 'filter', 'coarse', 'fine', 'deliver', 'map', 'end_to_end'];

const of = (evaluation, alignment) => evaluation?.ape?.[alignment];

export class RunPanels {
  /** `choose(i)`: another run is the one whose time and details are shown. */
  constructor(root, drives, theme, choose) {
    this.root = root;
    this.drives = drives;
    this.theme = theme;
    this.choose = choose;
    this.several = drives.length > 1;
    this.charts = [];
    this.show(0);
  }

  colour(i) { return () => runColours[this.theme()][i % runColours[this.theme()].length]; }

  show(selected) {
    this.selected = selected;
    for (const chart of this.charts) chart.remove();
    this.charts = [];
    const drive = this.drives[selected];
    const cards = [];
    if (this.several) cards.push(this.comparison());
    cards.push(this.summary(drive), ...this.errors(), ...this.motion(drive), this.latency(drive), this.imu(drive), this.events(drive), this.configuration(drive));
    this.root.replaceChildren(...cards.filter(Boolean).map((c) => c.made));
  }

  chart(title, series, options) {
    const chart = new Chart(title, series, { height: 116, ...options });
    this.charts.push(chart);
    return chart;
  }

  comparison() {
    const rows = this.drives.map((drive, i) => {
      const r = drive.run, e = r.evaluation;
      return {
        cells: [r.result?.path_length_m ?? r.path_length_m, of(e, 'origin')?.translation_m?.rmse, e?.rpe?.translation_m?.rmse,
          e?.end_drift?.percent, r.latency?.counters && r.pose_count ? (100 * (r.latency.counters.poses_tracking ?? 0)) / r.pose_count : null, this.processingP50(r), this.processingP99(r)],
        drive, i,
      };
    });
    // Smaller is better but for the path and the share of tracking.
    const direction = [0, 1, 1, 1, -1, 1, 1];
    const best = direction.map((d, k) => {
      const list = rows.map((row) => row.cells[k]).filter((v) => Number.isFinite(v));
      return d === 0 || list.length < 2 ? null : d > 0 ? Math.min(...list) : Math.max(...list);
    });
    rows.sort((a, b) => (a.cells[1] ?? Infinity) - (b.cells[1] ?? Infinity));
    const digits = [1, 3, 4, 3, 1];
    const made = table(['run', 'path m', 'APE m', 'RPE m', 'drift %', 'tracking %', 'p50', 'p99'], rows.map(({ cells, drive, i }) => {
      const dot = element('i', { class: 'dot' });
      dot.style.background = this.colour(i)();
      const eye = element('input', { type: 'checkbox', 'aria-label': `Show ${drive.name}` });
      eye.checked = drive.visible !== false;
      eye.addEventListener('change', () => { drive.visible = eye.checked; this.onVisible?.(); });
      const button = element('button', { class: `run-name${i === this.selected ? ' chosen' : ''}`, onclick: () => this.choose(i) }, drive.name);
      return [[eye, dot, button], ...cells.map((value, k) => {
        const shown = k < 5 ? number(value, digits[k]) : duration(value);
        return best[k] !== null && value === best[k] ? element('b', {}, shown) : shown;
      })];
    }), { class: 'compare' });
    const c = card('Runs', made);
    c.aside.textContent = 'best in bold; p50, p99: processing of a scan';
    return c;
  }

  stage(run, name) { return run.latency?.stages?.[name]; }
  /** Sum of the columns of a scan that are work, not waiting. */
  processingOf(run) {
    const s = run.scans;
    if (!s) return [];
    return s.time_s.map((_, i) => processing.slice(0, 4).reduce((sum, name) => sum + (s[`${name}_us`]?.[i] ?? 0), 0) / 1000);
  }
  processingAt(run, q) {
    const list = this.processingOf(run).sort((a, b) => a - b);
    return list.length ? list[Math.min(list.length - 1, Math.ceil(q * list.length) - 1)] : null;
  }
  processingP50(run) { return this.processingAt(run, 0.5); }
  processingP99(run) { return this.processingAt(run, 0.99); }

  summary(drive) {
    const { run } = drive;
    const e = run.evaluation;
    const result = run.result ?? {};
    const c = run.latency?.counters ?? {};
    const share = (n) => (run.pose_count ? `${((100 * (n ?? 0)) / run.pose_count).toFixed(n && n < run.pose_count ? 1 : 0)} %` : '–');
    const figures = [
      ['m driven', number(run.path_length_m, 1)],
      ['duration', clock(drive.duration)],
      ['poses', count(run.pose_count)],
      e ? ['% end drift', number(e.end_drift?.percent, 3)] : ['tracking', share(c.poses_tracking)],
    ].map(([name, value]) => { const f = figure(name); f.set(value); return f.made; });
    const rows = [];
    if (run.latency?.counters) rows.push(['states', `tracking ${share(c.poses_tracking)}, degraded ${share(c.poses_degraded)}, lost ${share(c.poses_lost)}, initialising ${share(c.poses_initialising)}`]);
    if (run.latency?.clock_source) rows.push(['LiDAR time', words(run.latency.clock_source)]);
    if (c.packets_lost !== undefined) rows.push(['packets lost', `${count(c.packets_lost)} of ${count(c.packets + c.packets_lost)}`]);
    if (result.cpu_s) rows.push(['CPU', `${number(result.cpu_s, 1)} s for ${number(drive.duration, 1)} s of drive: ${number((100 * result.cpu_s) / drive.duration, 0)} % of one core`]);
    if (result.peak_memory_bytes) rows.push(['peak memory', `${(result.peak_memory_bytes / 2 ** 20).toFixed(0)} MiB`]);
    rows.push(['begin', new Date(run.start_unix_s * 1000).toISOString().replace('T', ' ').slice(0, 19) + ' UTC']);
    if (run.map) rows.push(['map', run.map.shown < run.map.points ? `${count(run.map.shown)} of ${count(run.map.points)} points shown` : `${count(run.map.points)} points`]);
    if (result.versions?.nilio) rows.push(['version', `${result.versions.nilio}, configuration ${String(result.configuration_hash ?? '').slice(0, 12)}`]);
    if (result.trajectory_sha256) rows.push(['trajectory SHA-256', `${result.trajectory_sha256.slice(0, 16)}…`]);
    const notes = (run.notes ?? []).map((note) => element('p', { class: 'problem', 'data-tone': 'warn' }, note));
    const made = card(this.several ? drive.name : 'Run', element('div', { class: 'figures' }, figures), pairs(rows), notes);
    made.aside.textContent = this.several ? '' : drive.name;
    return made;
  }

  errors() {
    const with_ = this.drives.map((drive, i) => ({ drive, i })).filter(({ drive }) => drive.run.errors);
    if (!with_.length) return [];
    const series = with_.map(({ drive, i }) => ({ label: this.several ? drive.name : 'error', colour: this.colour(i), fill: !this.several, digits: 3 }));
    const overlay = (key, field) => {
      if (with_.length === 1) return [with_[0].drive.run.errors[key].t, with_[0].drive.run.errors[key][field]];
      // One axis of times for all.
      const times = [...new Set(with_.flatMap(({ drive }) => drive.run.errors[key].t))].sort((a, b) => a - b);
      return [times, ...with_.map(({ drive }) => {
        const map = new Map(drive.run.errors[key].t.map((t, i) => [t, drive.run.errors[key][field][i]]));
        return times.map((t) => map.get(t) ?? null);
      })];
    };
    const statistics = with_.length === 1 ? of(with_[0].drive.run.evaluation, 'origin')?.translation_m : null;
    const ape = this.chart('absolute position error', series, { unit: 'm', digits: 3, limits: () => (statistics ? [[statistics.rmse, '--warn']] : []) });
    const apeDeg = this.chart('absolute rotation error', series, { unit: '°', digits: 3 });
    const rpe = this.chart('relative position error over 10 m', series, { unit: 'm', digits: 3 });
    ape.update(overlay('ape', 'm'));
    apeDeg.update(overlay('ape', 'deg'));
    rpe.update(overlay('rpe_10m', 'm'));
    const { drive } = with_.find(({ i }) => i === this.selected) ?? with_[0];
    const e = drive.run.evaluation;
    const made = card('Error against the truth', ape.made, apeDeg.made, rpe.made, this.errorTable(e), this.segmentTable(e));
    made.aside.textContent = `${drive.run.truth_path ?? ''}, aligned at the origin`;
    return [made];
  }

  errorTable(e) {
    if (!e) return null;
    const row = (name, s, digits) => s && [name, ...['rmse', 'mean', 'median', 'std', 'max'].map((k) => number(s[k], digits))];
    const origin = of(e, 'origin'), se3 = of(e, 'se3'), rpe = e.rpe;
    return table(['', 'RMSE', 'mean', 'median', 'std', 'max'], [
      row('APE m', origin?.translation_m, 4), row('APE °', origin?.rotation_deg, 4),
      row('APE m, SE(3)', se3?.translation_m, 4), row('RPE m', rpe?.translation_m, 5), row('RPE °', rpe?.rotation_deg, 5)].filter(Boolean));
  }

  segmentTable(e) {
    const groups = [['KITTI segments', e?.segments], ['short segments', e?.short_segments]];
    const rows = [];
    for (const [name, group] of groups) {
      if (!group) continue;
      const all = group.all ?? group;
      rows.push([element('b', {}, name), number(all.translation_percent, 4), number(all.rotation_deg_per_100m, 4), count(all.segments)]);
      for (const s of group.per_length ?? []) rows.push([`${s.length_m} m`, number(s.translation_percent, 4), number(s.rotation_deg_per_100m, 4), count(s.segments)]);
    }
    return rows.length ? table(['segments', 't %', '°/100 m', 'number'], rows) : null;
  }

  motion(drive) {
    const { poses, truth } = drive.run;
    const axis = (names, titles, unit, colours, digits, fromZero) => names.map((name, k) => {
      const series = [{ label: 'estimate', colour: colours[k], digits }];
      if (truth) series.push({ label: 'truth', colour: '--muted', dash: [4, 4], width: 1.4, digits });
      const chart = this.chart(titles[k], series, { unit, height: 84, fromZero });
      if (!truth) chart.update([poses.t, poses[name]]);
      else {
        const map = new Map(truth.t.map((t, i) => [t, truth[name][i]]));
        chart.update([poses.t, poses[name], poses.t.map((t) => map.get(t) ?? null)]);
      }
      return chart.made;
    });
    const speed = this.chart('speed', [{ label: 'speed', colour: '--accent', fill: true }], { unit: 'm/s', height: 84 });
    speed.update([[...drive.path.time], [...drive.path.speed]]);
    const position = card('Position', speed.made, ...axis(['x', 'y', 'z'], ['x', 'y', 'z'], 'm', ['--red', '--green', '--accent'], 2, false));
    const attitude = card('Attitude', ...axis(['roll_deg', 'pitch_deg', 'yaw_deg'], ['roll', 'pitch', 'yaw'], '°', ['--red', '--green', '--accent'], 2, false));
    position.aside.textContent = attitude.aside.textContent = 'odom → base_link';
    return [position, attitude];
  }

  latency(drive) {
    const { run } = drive;
    const stages = run.latency?.stages;
    if (!stages && !run.scans) return null;
    const fullSpeed = run.latency?.full_speed === true;
    const content = [];
    if (run.scans) {
      const budget = run.latency?.budget?.mode && run.latency.budget.mode !== 'off' ? run.latency.budget.budget_ms : 0;
      const title = fullSpeed ? 'processing of a scan' : 'last packet → pose';
      const chart = this.chart(title, [{ label: fullSpeed ? 'processing' : 'latency', colour: '--accent', fill: true }], { unit: 'ms', limits: () => (budget > 0 && !fullSpeed ? [[budget, '--bad']] : []) });
      chart.update([run.scans.time_s, fullSpeed ? this.processingOf(run) : run.scans.end_to_end_us.map((v) => (v === null ? null : v / 1000))]);
      content.push(chart.made);
      const points = this.chart('points registered', [{ label: 'points', colour: '--green', digits: 0 }], { height: 76, digits: 0 });
      points.update([run.scans.time_s, run.scans.points_used]);
      content.push(points.made);
    }
    const row = (name, s) => [stageNames[name] ?? words(name), ...['p50_us', 'p90_us', 'p99_us', 'max_us'].map((k) => duration(s[k] / 1000))];
    const rows = (fullSpeed ? processing : wholeOrder).filter((name) => stages?.[name]?.count > 0).map((name) => row(name, stages[name]));
    const written = run.latency?.published?.received_to_written;
    if (!fullSpeed && written?.count > 0) rows.push(row('received_to_written', written));
    if (rows.length) content.push(table(['stage', 'p50', 'p90', 'p99', 'max'], rows, { class: 'stage-table' }));
    const b = run.latency?.budget;
    if (b?.degradation_levels) {
      const list = Object.entries(b.degradation_levels).filter(([, n]) => n > 0).map(([name, n]) => `${words(name)} ${count(n)}`).join(', ');
      content.push(pairs([['degradation levels', list || '–'], ...(b.mode && b.mode !== 'off' ? [['budget', `${b.budget_ms} ms (${b.mode})`], ['late poses', count(b.late_poses)]] : [])]));
    }
    const made = card(fullSpeed ? 'Processing time' : 'Latency', content);
    made.aside.textContent = fullSpeed ? 'replay at full speed: says nothing of latency' : 'at the pace of the sensor';
    return made;
  }

  imu(drive) {
    const imu = drive.run.latency?.imu;
    if (!imu || typeof imu !== 'object') return null;
    const rows = imu.checks ?? {};
    const chips = imuChecks.filter((name) => rows[name]).map((name) => {
      const check = rows[name];
      const state = check.worst_state ?? check.state ?? 'unknown';
      return element('span', { class: 'check', 'data-tone': state, title: `${words(name)}: now ${check.state}, worst ${state}; ${check.hint ?? ''}` },
        { ok: '✓', warn: '▲', bad: '✕' }[state] ?? '·', ' ', words(name), state === 'unknown' ? '' : element('small', {}, `${+Number(check.value).toPrecision(3)}${check.unit && check.unit !== '1' ? ` ${check.unit}` : ''}`));
    });
    const hints = imuChecks.filter((name) => rows[name]?.hint).map((name) => element('p', { class: 'problem', 'data-tone': rows[name].state === 'bad' ? 'bad' : 'warn' }, element('b', {}, words(name)), ` ${rows[name].hint}`));
    const use = imu.trusted === undefined ? '' : imu.trusted ? 'used' : 'not used';
    const made = card('IMU', element('div', { class: 'checks' }, chips, hints));
    made.aside.textContent = `${use}${use ? '; ' : ''}worst state of each check`;
    return made;
  }

  events(drive) {
    const events = drive.run.scans?.events ?? [];
    if (!events.length) return null;
    const list = element('ol', { class: 'events' }, events.map((event) => element('li', { 'data-level': event.level },
      element('button', { class: 'time', onclick: () => this.onTime?.(event.time_s) }, clock(event.time_s)), element('span', {}, { error: '✕ ', warning: '▲ ' }[event.level] ?? '', event.text))));
    const made = card('Events', list);
    made.aside.textContent = `${events.length}`;
    return made;
  }

  configuration(drive) {
    if (!drive.run.config) return null;
    const made = card('Configuration', element('details', {}, element('summary', {}, 'config.yaml'), element('pre', {}, drive.run.config)));
    const inputs = drive.run.result?.inputs ?? [];
    if (inputs.length) made.body.append(table(['input', 'bytes', 'SHA-256'], inputs.map((i) => [String(i.path).split('/').pop(), count(i.bytes), `${String(i.sha256).slice(0, 12)}…`])));
    return made;
  }
}
