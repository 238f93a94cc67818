// The tables. The state comes five times a second; when the connection ends, everything is shown as old.
'use strict';

const by = (id) => document.getElementById(id);

/** A cell with text; nothing is ever shown as HTML. */
function cell(text, kind) {
  const own = document.createElement('td');
  own.textContent = text;
  if (kind) own.className = kind;
  return own;
}

function rows(table, all) {
  const body = by(table).tBodies[0];
  const made = all.map((cells) => {
    const row = document.createElement('tr');
    row.append(...cells);
    return row;
  });
  body.replaceChildren(...made);
}

const NOT_READ = '–';

/** A quantity of the board: in its unit, or the register's integer, which says so. */
function number(quantity, places) {
  if (!quantity) return NOT_READ;
  return quantity.value === null ? `${quantity.raw} raw` : quantity.value.toFixed(places);
}

const FAULTS = ['fatal-error', 'integrated-fatal-error', 'amplifier-fault', 'i2t-fault', 'phasing-error', 'limit-stop', 'warning-error',
  '-limit', '+limit', 'data-error'];

function flags(words) {
  const own = document.createElement('td');
  own.className = 'text words';
  words.forEach((word, index) => {
    const part = document.createElement('span');
    part.textContent = (index ? ' ' : '') + word;
    if (FAULTS.includes(word)) part.className = 'bad';
    own.append(part);
  });
  return own;
}

/** Hides the columns that no row has anything in. */
function hideEmpty(table, columns) {
  for (const [column, isFilled] of Object.entries(columns)) by(table).classList.toggle(`without-${column}`, !isFilled);
}

function motors(state) {
  hideEmpty('motors', {
    name: (state.motors || []).some((motor) => motor.name),
    unit: (state.motors || []).some((motor) => motor.user),
    velocity: (state.motors || []).some((motor) => motor.velocity),
  });
  const old = state.servo && state.servo.fresh ? '' : 'old';
  rows('motors', (state.motors || []).map((motor) => {
    const user = motor.user;
    const position = user && user.actual_position !== null ? `${user.actual_position.toFixed(4)} ${user.unit}` : '';
    return [
      // On a telephone the flags lie off the screen.
      cell(`#${motor.motor}`, !old && motor.words.some((word) => FAULTS.includes(word)) ? 'bad' : ''), cell(motor.name || '', 'text'),
      cell(number(motor.actual_position, 1), old), cell(position, old),
      cell(number(motor.following_error, 1), old), cell(number(motor.velocity, 1), old),
      old ? cell(NOT_READ, 'text') : flags(motor.words),
    ];
  }));
}

// How the axes of a program's moves are meant: of no use at a glance.
const ORDINARY = /_(feedrate|incremental)$/;

function systems(state) {
  const old = state.background && state.background.fresh ? '' : 'old';
  rows('systems', (state.coordinate_systems || []).map((system) => {
    const targets = Object.entries(system.axis_targets).filter(([, target]) => target !== null && target !== 0);
    const words = [...(system.status || []), ...(system.program_status || [])]
      .filter((flag) => !ORDINARY.test(flag)).map((flag) => flag.replaceAll('_', '-'));
    const left = system.time_left_in_move;
    return [
      cell(`&${system.coordinate_system}`), cell(system.motion_mode || NOT_READ, 'text'),
      cell(system.lines_remaining === null ? NOT_READ : String(system.lines_remaining), old),
      cell(left && left.value !== null ? left.value.toFixed(0) : NOT_READ, old),
      cell(targets.map(([axis, target]) => `${axis}${+target.toFixed(4)}`).join(' '), `text ${old}`),
      old ? cell(NOT_READ, 'text') : flags(words),
    ];
  }));
}

/** The words of `[[user]]` tables, and the variables that pmac-web asks the board for. */
function words(state) {
  const old = state.user && state.user.fresh ? '' : 'old';
  const own = (state.words || []).map(({ name, value, unit }) => [
    cell(name, 'text'), cell(value === null ? 'not whole' : [value].flat().join(' '), old), cell(unit || '', 'text'),
  ]);
  const { values, reason } = state.watched || { values: [] };
  // A recording that is over still answers.
  const askedOld = reason || (state.replay && state.condition !== 'live') ? 'old' : '';
  const asked = values.map(({ name, value }) => [
    cell(name, 'text'), cell(value === null ? NOT_READ : value, askedOld),
    cell(name.startsWith('Q') ? 'of the addressed system' : '', 'text'),
  ]);
  by('own').hidden = own.length + asked.length === 0;
  by('unasked').textContent = reason ? `Variables: ${reason}` : '';
  rows('words', [...own, ...asked]);
}

function list(id, entries) {
  by(id).replaceChildren(...entries.flatMap(([term, text]) => {
    const [dt, dd] = [document.createElement('dt'), document.createElement('dd')];
    dt.textContent = term;
    dd.textContent = text;
    return [dt, dd];
  }));
}

function health(state) {
  const rate = (region) => (region.state === 'live' && region.period_ns ? `, ${(1e9 / region.period_ns).toFixed(1)} Hz` : '');
  const regions = Object.entries(state.regions || {});
  list('health', [
    ['pmacd', state.uptime_s === undefined ? NOT_READ : `up ${Math.floor(state.uptime_s)} s`],
    ['servo cycle', state.servo_period_ns ? `${(state.servo_period_ns / 1e3).toFixed(3)} µs` : NOT_READ],
    ['global status', state.global_flags ? state.global_flags.join(' ').replaceAll('_', '-') || 'no flag is set' : NOT_READ],
    ...regions.map(([name, region]) => [`${name} data`, `${region.state}${rate(region)}`]),
  ]);
  const counters = Object.entries(state.counters || {});
  list('counters', counters.map(([name, count]) => [name.replaceAll('_', ' '), count.toLocaleString('en')]));
}

/** Shows a state, or that there is none. */
function show(state) {
  by('name').textContent = state.name;
  // Nothing of a recording is live.
  const condition = state.replay && state.condition === 'live' ? 'replay' : state.condition;
  document.title = `${state.replay ? 'REPLAY ' : ''}PMAC ${state.name}: ${condition}`;
  by('replay').hidden = !state.replay;
  by('condition').textContent = condition;
  by('condition').className = `badge ${condition}`;
  by('board').textContent = [state.type, state.family, state.firmware].filter(Boolean).join(', ');
  by('reason').textContent = state.reason || '';
  motors(state);
  systems(state);
  words(state);
  health(state);
  scope.offer(state.motors || []);
}

let last = { name: document.title, condition: 'connecting' };
const events = new EventSource('events');
events.onmessage = (event) => {
  last = JSON.parse(event.data);
  show(last);
};
// The browser connects again by itself.
events.onerror = () => {
  const old = (part) => (part ? { ...part, fresh: false } : part);
  const why = 'pmac-web does not answer: what is shown is old';
  last = { ...last, condition: 'disconnected', reason: why, servo: old(last.servo), background: old(last.background),
    user: old(last.user), watched: last.watched && { ...last.watched, reason: why } };
  show(last);
};
