// Import of logs that others recorded: the guessed map as a table, its signals, the recording.

import { attempt, bench, command, fill, find, get, h, number, post, take } from './dom.js';

const DRIVE = ['position', 'velocity', 'torque', 'command', 'voltage', 'current', 'power', 'temperature'];
const SUPPLY = ['voltage', 'current', 'power'];
let log = null;
let map = null;
let known = null;
let parts = null;

const short = (path) => path.split('/').pop();

function build() {
  const { logs } = bench.known;
  const file = h('select', { id: 'log-file', 'aria-label': 'Log' }, logs.map((path) => h('option', { value: path }, path.split('/').slice(-2).join('/'))));
  const look = h('button', { type: 'button', onclick: () => attempt(() => post('log', { file: file.value })) }, 'Look into it');
  const body = h('div');
  parts = { body, look };
  const none = 'No log lies in the folders that were named. Start again with its folder: ros2 run power_workbench open logs/';
  fill(find('logs-body'), h('details', { id: 'import' }, h('summary', {}, `Import a log of others (${logs.length} here)`),
    h('p', { class: 'faint' }, 'csv, xlsx, parquet, mat, HDF5, JSON, hebilog, bags of other topics. The page guesses which column is what; you correct it.'),
    logs.length ? h('div', { class: 'row' }, file, look) : h('p', {}, none), body));
}

export async function update() {
  if (!parts) build();
  const { state } = bench;
  parts.look.disabled = Boolean(state.job);
  for (const button of parts.body.querySelectorAll('button.work')) button.disabled = Boolean(state.job);
  if (!state.log || state.log === known) return;
  known = state.log;
  const found = await attempt(() => get('log'));
  if (!found || !found.file) return;
  const fresh = !log || log.file !== found.file || !found.result;
  log = found;
  find('import').open = true;
  if (fresh) { map = structuredClone(log.map); draw(); }
  result();
}

/** An entry of the map as an object that can be changed; it is made where it is not there. */
function entry(place) {
  let at = map;
  for (const key of place) { at[key] ||= {}; at = at[key]; }
  return at;
}

function text(place, key, label, width, list) {
  const at = place.reduce((node, one) => (node || {})[one], map) || {};
  const value = key === 'from' && at.from == null && at.value != null ? `= ${at.value}` : at[key] ?? '';
  return h('input', {
    type: 'text', value, list: list || null, 'aria-label': `${label}: ${key === 'from' ? 'column' : key}`, style: `width: ${width}`,
    oninput: (event) => set(place, key, event.target.value.trim()),
  });
}

/** Set one field; a column that is empty takes the signal out, and `= 48` is a constant. */
function set(place, key, value) {
  const at = entry(place);
  const constant = key === 'from' && /^=\s*(-?[\d.]+)$/.exec(value);
  if (key === 'from') { delete at.from; delete at.value; }
  if (constant) at.value = Number(constant[1]);
  else if (value === '') delete at[key];
  else at[key] = key === 'scale' || key === 'rate' ? Number(value) : value;
  if (key === 'from' && value === '') delete entry(place.slice(0, -1))[place[place.length - 1]];
}

function pick(place, key, label, options) {
  const at = place.reduce((node, one) => (node || {})[one], map) || {};
  return h('select', { 'aria-label': `${label}: ${key}`, onchange: (event) => set(place, key, event.target.value) },
    options.map(([value, words]) => h('option', { value, selected: (at[key] || options[0][0]) === value }, words)));
}

function row(place, quantity, label) {
  const name = place.join('.');
  const more = quantity === 'torque' ? pick(place, 'at', label, [['joint', 'at the joint'], ['motor', 'of the motor']])
    : quantity === 'current' || quantity === 'power' ? pick(place, 'positive', label, [['drawn', 'drawn is +'], ['fed', 'fed is +']]) : '';
  const remark = log.remarks[name];
  return h('tr', { 'data-place': name }, h('th', { scope: 'row' }, quantity),
    h('td', {}, text(place, 'from', label, '15rem', 'log-columns')), h('td', {}, text(place, 'unit', label, '5rem')),
    h('td', {}, text(place, 'scale', label, '5rem')), h('td', {}, more),
    h('td', { class: 'faint' }, remark || ''));
}

function table(place, quantities, title) {
  const heads = ['signal', 'column, or = a number', 'unit', 'scale', '', 'remark'].map((one) => h('th', { scope: 'col' }, one));
  return h('div', { class: 'scroll', tabindex: 0, role: 'group', 'aria-label': title }, h('table', { class: 'map' }, h('thead', {}, h('tr', {}, heads)),
    h('tbody', {}, quantities.map((quantity) => row([...place, quantity], quantity, `${title} ${quantity}`)))));
}

function drives() {
  return Object.keys(map.drives || {}).map((name) => {
    const field = h('input', { type: 'text', value: name, 'aria-label': `Name of ${name}`, onchange: (event) => {
      const wanted = event.target.value.trim();
      if (!wanted || map.drives[wanted]) { event.target.value = name; return; }
      map.drives = Object.fromEntries(Object.entries(map.drives).map(([key, value]) => [key === name ? wanted : key, value]));
      draw();
    } });
    const drop = h('button', { type: 'button', 'aria-label': `Leave out ${name}`, onclick: () => { delete map.drives[name]; draw(); } }, 'Leave out');
    return h('div', {}, h('div', { class: 'row' }, field, drop), table(['drives', name], DRIVE, name));
  });
}

function time() {
  if (log.is_bag) return h('label', {}, 'time of ', pick(['time'], 'stamp', 'Time', [['header', 'the message’s header'], ['log', 'its arrival']]));
  return h('div', { class: 'row', 'data-place': 'time' }, 'Time: column', text(['time'], 'column', 'Time', '12rem', 'log-columns'), 'unit', text(['time'], 'unit', 'Time', '4rem'),
    'or rate in Hz', text(['time'], 'rate', 'Time', '5rem'), h('span', { class: 'faint' }, log.remarks.time || ''));
}

function draw() {
  const ready = log.ready.map((one) => h('button', { type: 'button', onclick: () => { map = structuredClone(one.map); draw(); } }, `Use the ready map ${one.name}`));
  const send = (preview) => attempt(() => post('log', { file: log.file, map, preview }));
  const columns = log.columns.map((one) => h('option', { value: one.address }, one.low == null ? '' : `${number(one.low)} … ${number(one.high)} ${one.unit}`));
  fill(parts.body, h('datalist', { id: 'log-columns' }, columns),
    h('h3', {}, `Map of ${short(log.file)}`), h('p', { class: 'faint' }, `${log.columns.length} columns. Guessed from their names: check the units, and which torque it is. A signal without a column is left out.`),
    ready.length ? h('div', { class: 'row' }, ready) : null, time(), drives(),
    table(['supply'], SUPPLY, 'supply of the whole robot'),
    h('p', { id: 'log-error', role: 'alert', class: 'none_of_the_above' }),
    h('div', { class: 'row' }, h('button', { type: 'button', class: 'work', onclick: () => send(true) }, 'Preview in SI units'), h('button', { type: 'button', class: 'work main', onclick: () => send(false) }, 'Import')),
    h('div', { id: 'log-result' }));
}

/** The row of the map that an error is about; a name with a * stands for those that it fits. */
function rowOf(place) {
  for (const node of parts.body.querySelectorAll('[data-place]')) {
    const pattern = node.dataset.place.replace(/[.+?^${}()|[\]\\]/g, '\\$&').replaceAll('*', '.+');
    if (new RegExp(`^${pattern}(\\..*)?$`).test(place)) return node;
  }
  return parts.body.querySelector(`[data-place^="${CSS.escape(place)}."]`);
}

function result() {
  for (const node of parts.body.querySelectorAll('[aria-invalid]')) node.removeAttribute('aria-invalid');
  for (const node of parts.body.querySelectorAll('.at-field')) node.remove();
  const found = log.result;
  const said = find('log-error');
  if (!said) return;
  said.textContent = '';
  fill(find('log-result'));
  if (!found) return;
  if (found.error) {
    const node = found.place ? rowOf(found.place) : null;
    said.textContent = found.place ? `${found.place}: ${found.error}` : found.error;
    if (!node) return;
    const field = node.querySelector('input');
    field.setAttribute('aria-invalid', 'true');
    (node.lastElementChild || node).prepend(h('strong', { class: 'at-field none_of_the_above' }, `${found.error} `));
    field.focus();
    return;
  }
  if (found.path) {
    fill(find('log-result'), h('p', {}, `Imported: ${found.counts}.`), found.notes.length ? h('ul', {}, found.notes.map((one) => h('li', {}, one))) : null,
      h('div', { class: 'row' }, h('button', { type: 'button', class: 'main', onclick: () => take({ kind: 'open', recordings: [found.path] }) }, 'Open the recording'),
        bench.state.opened.length ? h('button', { type: 'button', onclick: () => take({ kind: 'open', recordings: [...bench.state.opened, found.path] }) }, 'Open it with the present ones') : null),
      command(found.command));
    return;
  }
  fill(find('log-result'), h('div', { class: 'scroll', tabindex: 0, role: 'group', 'aria-label': 'Signals in SI units' }, h('table', {},
    h('caption', {}, 'The first rows as they would be imported'),
    h('thead', {}, h('tr', {}, ['drive', 'signal', 'from', 'to', 'unit', 'shape'].map((one) => h('th', { scope: 'col' }, one)))),
    h('tbody', {}, found.signals.map((one) => h('tr', {}, h('td', {}, one.drive || 'supply'), h('td', {}, one.quantity), h('td', { class: 'number' }, number(one.low)), h('td', { class: 'number' }, number(one.high)), h('td', {}, one.unit), h('td', {}, sparkline(one))))))),
  command(found.command));
}

function sparkline(one) {
  const drawn = document.createElementNS('http://www.w3.org/2000/svg', 'svg');
  drawn.setAttribute('viewBox', '0 0 240 28');
  drawn.setAttribute('class', 'spark');
  drawn.setAttribute('role', 'img');
  drawn.setAttribute('aria-label', `${one.quantity} of ${one.drive || 'the supply'}, ${number(one.low)} to ${number(one.high)} ${one.unit}`);
  const line = document.createElementNS('http://www.w3.org/2000/svg', 'polyline');
  const span = one.high - one.low || 1;
  const last = Math.max(one.values.length - 1, 1);
  line.setAttribute('points', one.values.map((value, index) => (value == null ? null : `${((240 * index) / last).toFixed(1)},${(26 - (24 * (value - one.low)) / span).toFixed(1)}`)).filter(Boolean).join(' '));
  drawn.append(line);
  return drawn;
}
