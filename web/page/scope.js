// The scope: every servo update of the traces chosen, by the board's own time.
'use strict';

const scope = (() => {
  const own = (id) => document.getElementById(id);
  // Each is to be seen on a light and on a dark page.
  const COLOURS = ['#3b82f6', '#e8590c', '#12a150', '#a855f7', '#b58900', '#0ea5b7', '#e0467c', '#6b9b1e'];
  const UNITS = {
    commanded_position: 'counts', actual_position: 'counts', master_position: 'counts of the master', following_error: 'counts of error',
    compensation_position: 'counts', position_bias: 'counts', velocity: 'counts/s', actual_velocity: 'counts per servo cycle',
    previous_dac: 'DAC bits', time_left: 'ms', filtered_velocity: 'averaged',
  };
  // A moment before the trigger is shown, so that one sees what led to it.
  const BEFORE = 0.2;
  // Kept besides the time base: what a trigger may still need.
  const KEEP = 2.5;
  // How often is drawn.
  const FRAME_MS = 50;

  let traces = [];
  let times = [];
  let values = [];
  let source = null;
  let plot = null;
  let generation = null;
  let runs = true;
  let armed = null; // From this time on a trigger counts.
  let frozen = null; // The window that a trigger chose.
  let dirty = true;
  let lost = 0;
  let xLabel = 'time (s)';
  let offered = '';

  const height = () => Math.max(220, Math.min(380, window.innerHeight * 0.4));
  const span = () => Number(own('span').value);
  const unit = (trace) => UNITS[trace.split('.')[1]] || '';
  const label = (trace) => `#${trace.replace('.', ' ').replaceAll('_', ' ')}`;
  const tell = (text) => { own('told').textContent = text; };

  /** Begins with nothing. */
  function clear() {
    times = [];
    values = traces.map(() => []);
    frozen = null;
    armed = null;
    dirty = true;
  }

  /** Asks for the present traces. */
  function connect() {
    if (source) source.close();
    source = null;
    clear();
    if (!traces.length) return;
    source = new EventSource(`scope?traces=${traces.join(',')}`);
    source.onmessage = (event) => take(JSON.parse(event.data));
    source.onerror = () => tell('not connected');
  }

  function take(batch) {
    if (batch.behind) {
      tell(`this browser is too slow: ${batch.behind} batches left out`);
      return;
    }
    if (batch.generation !== generation) {
      generation = batch.generation;
      clear();
    }
    xLabel = batch.cycles ? 'time (servo cycles)' : 'time (s)';
    lost += batch.lost;
    const said = [];
    // The head of the page says why.
    if (batch.stale) said.push('STALE: no updates come');
    if (batch.unscaled) said.push('a trace has no values: the board has not told the scale of its motor (Ix08, Ix09)');
    if (lost) said.push(`${lost} updates lost`);
    tell(said.join('; '));
    if (!runs || !batch.t.length) return;
    // The board was reset: its time begins anew.
    if (times.length && batch.t[0] < times[times.length - 1]) clear();
    const first = times.length;
    for (const time of batch.t) times.push(time);
    batch.v.forEach((more, index) => { for (const value of more) values[index].push(value); });
    trigger(first);
    trim();
    dirty = true;
  }

  /** Forgets what no window can show any more. */
  function trim() {
    const oldest = Math.min(times[times.length - 1] - span() * KEEP, frozen ? frozen[0] : Infinity);
    let drop = 0;
    while (drop < times.length && times[drop] < oldest) drop += 1;
    // In large pieces, so that each costs little.
    if (drop > times.length / 2 || drop > 5000) {
      times.splice(0, drop);
      values.forEach((trace) => trace.splice(0, drop));
    }
  }

  /** Looks for the next trigger from sample `first` on. */
  function trigger(first) {
    const mode = own('mode').value;
    if (mode === 'free') { frozen = null; armed = null; return; }
    const now = times[times.length - 1];
    if (frozen && (mode === 'single' || now < frozen[1])) {
      if (mode === 'single' && now >= frozen[1]) stop();
      return;
    }
    const index = Number(own('source').value) || 0;
    const [level, slope] = [Number(own('level').value), Number(own('slope').value)];
    const trace = values[index];
    if (armed === null) armed = times[0] + span() * BEFORE;
    for (let at = Math.max(first, 1); at < times.length; at += 1) {
      const [was, is] = [trace[at - 1], trace[at]];
      if (times[at] < armed || was === null || is === null) continue;
      if ((was - level) * slope < 0 && (is - level) * slope >= 0) {
        frozen = [times[at] - span() * BEFORE, times[at] + span() * (1 - BEFORE)];
        armed = frozen[1];
        return;
      }
    }
  }

  function stop() {
    runs = false;
    own('run').textContent = 'run';
  }

  function run() {
    runs = true;
    own('run').textContent = 'stop';
    lost = 0;
    clear();
  }

  /** The plot for the present traces: an axis for each unit, the first on the left. */
  function build() {
    if (plot) plot.destroy();
    plot = null;
    if (!traces.length) return;
    const units = [...new Set(traces.map(unit))];
    const style = getComputedStyle(document.body);
    const ink = style.getPropertyValue('--ink');
    const grid = { stroke: style.getPropertyValue('--line'), width: 1 };
    // Room for the longest number beside the label.
    const size = (_, numbers) => 16 + 7 * Math.max(2, ...(numbers ?? []).map((number) => number.length));
    const axis = { stroke: ink, grid, ticks: { ...grid, size: 6 }, size, labelSize: 18 };
    // The actual position lies on the commanded one, which shows at both sides of it.
    const width = (trace) => (trace.endsWith('.commanded_position') ? 4 : 1.5);
    const series = traces.map((trace, index) => ({
      stroke: COLOURS[index % COLOURS.length], width: width(trace), scale: unit(trace), spanGaps: false,
    }));
    const axes = units.map((name, index) => ({
      ...axis, scale: name, label: name || 'raw', side: index ? 1 : 3, grid: index ? { show: false } : grid,
    }));
    const limits = Object.fromEntries(units.map((name) => [name, { auto: true, range: range }]));
    plot = new uPlot({
      width: own('plot').clientWidth, height: height(),
      scales: { x: { time: false }, ...limits },
      series: [{}, ...series],
      axes: [{ ...axis, size: 28, label: xLabel }, ...axes],
      legend: { show: false },
      hooks: { setCursor: [tellValues] },
    }, [[], ...traces.map(() => [])], own('plot'));
    dirty = true;
  }

  /** A little room around the values; a steady one lies in the middle. */
  function range(_, low, high) {
    if (low === null || !Number.isFinite(low)) return [-1, 1];
    const room = Math.max((high - low) * 0.08, Math.abs(high) * 1e-9, 0.5);
    return [low - room, high + room];
  }

  /** The values at the cursor, else the latest, on the traces' buttons. */
  function tellValues({ data: [time, ...all], cursor } = plot) {
    const at = Math.min(cursor.idx ?? Infinity, time.length - 1);
    own('at').textContent = cursor.idx == null || !time.length ? '' : `at ${time[at].toFixed(4)}`;
    all.forEach((trace, index) => {
      const value = trace[at];
      const shown = value === null || value === undefined ? '–' : value.toFixed(2);
      own('traces').children[index].textContent = `${label(traces[index])} ${shown} ${unit(traces[index]) || 'raw'} ×`;
    });
  }

  function draw() {
    if (!plot || !dirty) return;
    dirty = false;
    if (!times.length) {
      plot.setData([[], ...traces.map(() => [])]);
      tellValues();
      return;
    }
    const end = frozen ? frozen[1] : times[times.length - 1];
    const begin = frozen ? frozen[0] : end - span();
    const from = bisect(begin);
    const to = frozen ? bisect(end) : times.length;
    const zero = frozen ? begin + span() * BEFORE : end;
    const shown = times.slice(from, to).map((time) => time - zero);
    plot.setData([shown, ...values.map((trace) => trace.slice(from, to))], true);
    plot.setScale('x', { min: begin - zero, max: end - zero });
    tellValues();
  }

  /** The first sample at or after `time`. */
  function bisect(time) {
    let [low, high] = [0, times.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] < time) low = middle + 1; else high = middle;
    }
    return low;
  }

  function choose(next) {
    traces = next;
    const buttons = traces.map((trace, index) => {
      const button = document.createElement('button');
      button.type = 'button';
      button.title = 'remove this trace';
      button.style.borderLeftColor = COLOURS[index % COLOURS.length];
      button.onclick = () => choose(traces.filter((other) => other !== trace));
      return button;
    });
    own('traces').replaceChildren(...buttons);
    own('source').replaceChildren(...traces.map((trace, index) => new Option(label(trace), index)));
    connect();
    build();
  }

  function change() {
    if (!runs) run();
    frozen = null;
    armed = null;
    dirty = true;
  }

  for (const id of ['span', 'mode', 'source', 'slope', 'level']) own(id).onchange = change;
  own('controls').onsubmit = (event) => event.preventDefault();
  own('run').onclick = () => (runs ? stop() : run());
  own('add').onclick = () => {
    const trace = `${own('motor').value}.${own('field').value}`;
    if (own('field').value && !traces.includes(trace) && traces.length < COLOURS.length) choose([...traces, trace]);
  };
  window.addEventListener('resize', () => plot && plot.setSize({ width: own('plot').clientWidth, height: height() }));
  window.matchMedia('(prefers-color-scheme: dark)').addEventListener('change', build);
  // A telephone has no room for them.
  if (window.innerWidth < 700) document.querySelector('details').open = false;
  setInterval(draw, FRAME_MS);

  return {
    /** What the plot shows: the times, and the values of each trace. */
    shown: () => (plot ? plot.data : []),

    /** The axis of each trace. */
    scales: () => plot.series.slice(1).map((series) => series.scale),

    /** The motors and values that there are to choose from. */
    offer(motors) {
      const numbers = motors.map((motor) => motor.motor);
      if (!numbers.length || String(numbers) === offered) return;
      offered = String(numbers);
      const first = motors[0];
      // pmac-web works out a commanded position that the board does not report.
      const fields = Object.keys(UNITS).filter((field) => field in first || field === 'commanded_position');
      own('motor').replaceChildren(...motors.map(({ motor, name }) => new Option(`#${motor} ${name || ''}`, motor)));
      own('field').replaceChildren(...fields.map((field) => new Option(field.replaceAll('_', ' '), field)));
      const shown = ['commanded_position', 'actual_position', 'following_error'];
      if (!traces.length) choose(shown.map((field) => `${numbers[0]}.${field}`));
    },
  };
})();
