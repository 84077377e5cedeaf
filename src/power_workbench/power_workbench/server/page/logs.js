// Import of logs that others recorded: the guessed map as a table, its signals, the recording.

import { attempt, bench, command, fill, find, get, h, number, post, take, upload } from './dom.js';
import { shortened } from './model.js';

const DRIVE = ['position', 'velocity', 'torque', 'motor_current', 'command', 'voltage', 'current', 'power', 'efficiency', 'loss', 'temperature'];
const SUPPLY = ['voltage', 'current', 'power'];
const MEANS = {
  motor_current: 'motor current (beside a torque sensor: both sides of the gear)',
  efficiency: 'efficiency (% or 1; the power is torque · speed over it)',
  loss: 'loss (W; the power is torque · speed plus it)',
};
const TIMES = { column: 'a column', columns: 'two columns, added', rate: 'none: a constant rate', steady: 'none: operating points' };
let log = null;
let map = null;
let known = null;
let parts = null;
let extra = new Set(); // places that are shown though the map has no column for them
let last = null;

const short = (path) => path.split('/').pop();

function build() {
  const { logs } = bench.known;
  const fits = (path, wanted) => path.toLowerCase().includes(wanted.toLowerCase());
  const options = (wanted) => logs.filter((path) => fits(path, wanted)).map((path) => h('option', { value: path }, shortened(path)));
  const file = h('select', { id: 'log-file', 'aria-label': 'Log' }, options(''));
  const find_ = h('input', { type: 'text', placeholder: 'part of its name', 'aria-label': 'Show logs with', oninput: (event) => fill(file, options(event.target.value)) });
  const look = h('button', { type: 'button', onclick: () => attempt(() => post('log', { file: file.value })) }, 'Look into it');
  const chosen = h('input', { type: 'file', id: 'log-chosen', accept: bench.known.endings.join(), onchange: () => attempt(() => handOver(chosen)) });
  const body = h('div');
  parts = { body, look };
  fill(find('logs-body'), h('details', { id: 'import' }, h('summary', {}, 'Import CSV, MAT, HDF5 …'),
    h('p', { class: 'faint' }, 'Also xlsx, parquet, JSON, hebilog, and bags of other topics. The page guesses which column is what; you correct it.'),
    h('div', { class: 'row' }, h('label', {}, 'A file of this computer ', chosen), h('span', { class: 'faint', id: 'log-handed' }, 'It is copied to the session’s folder, up to 2 GB.')),
    logs.length ? h('div', { class: 'row' }, 'Or of the folders that were named', logs.length > 12 ? find_ : null, file, look) : null, body));
}

/** A browser does not say where a file lies, and the server reads named folders alone: a copy goes to the session. */
async function handOver({ files: [file] }) {
  if (!file) return;
  find('log-handed').textContent = `Copying ${file.name}…`;
  try {
    await post('log', await upload(file));
  } finally {
    find('log-handed').textContent = '';
  }
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
  find('import').open = find('recordings').querySelector('details').open = true;
  if (fresh) { map = structuredClone(log.map); extra = new Set(); draw(); }
  result();
}

const at = (place) => place.reduce((node, one) => (node || {})[one], map) || {};

/** An entry of the map as an object that can be changed; it is made where it is not there. */
function entry(place) {
  let node = map;
  for (const key of place) { node[key] ||= {}; node = node[key]; }
  return node;
}

const written = (signal) => (signal.sum ? signal.sum.map((term) => term.join(' × ')).join(' + ') : signal.from == null && signal.value != null ? `= ${signal.value}` : signal.from ?? '');

function text(place, key, label, width, list) {
  return h('input', {
    type: 'text', value: key === 'from' ? written(at(place)) : at(place)[key] ?? '', list: list || null, 'aria-label': `${label}: ${key === 'from' ? 'column' : key}`, style: `width: ${width}`,
    oninput: (event) => set(place, key, event.target.value.trim()),
  });
}

/** Set one field; an empty column takes the signal out, `= 48` is a constant, `a × b + c × d` a sum of products. */
function set(place, key, value) {
  const node = entry(place);
  const constant = key === 'from' && /^=\s*(-?[\d.]+)$/.exec(value);
  if (key === 'from') { delete node.from; delete node.value; delete node.sum; }
  if (constant) node.value = Number(constant[1]);
  else if (key === 'from' && value.includes('×')) node.sum = value.split('+').map((term) => term.split('×').map((one) => one.trim()));
  else if (value === '' || value === false) delete node[key];
  else node[key] = ['scale', 'rate', 'gear_ratio'].includes(key) ? Number(value) : value;
  if (key === 'from' && value === '') delete entry(place.slice(0, -1))[place[place.length - 1]];
}

function pick(place, key, label, options) {
  return h('select', { 'aria-label': `${label}: ${key}`, onchange: (event) => set(place, key, event.target.value) },
    options.map(([value, words]) => h('option', { value, selected: (at(place)[key] || options[0][0]) === value }, words)));
}

function row(place, quantity, label, geared) {
  const name = place.join('.');
  const side = [['joint', 'at the joint'], ['motor', 'of the motor']];
  const more = [];
  if (quantity === 'torque' || (geared && ['position', 'velocity', 'command'].includes(quantity))) more.push(pick(place, 'at', label, side));
  if (quantity === 'current' || quantity === 'power') {
    more.push(pick(place, 'positive', label, [['drawn', 'drawn is +'], ['fed', 'fed is +']]), ' ',
      h('label', { class: 'nowrap', title: 'A formula of the firmware, such as V · I of the motor: its losses are not in it' }, h('input', { type: 'checkbox', checked: Boolean(at(place).computed || at(place).sum), onchange: (event) => set(place, 'computed', event.target.checked) }), ' computed'));
  }
  return h('tr', { 'data-place': name }, h('th', { scope: 'row', title: MEANS[quantity] || null }, quantity.replace('_', ' ')),
    h('td', {}, text(place, 'from', label, '15rem', 'log-columns')), h('td', {}, text(place, 'unit', label, '5rem')),
    h('td', {}, text(place, 'scale', label, '4rem')), h('td', { class: 'nowrap' }, more),
    h('td', { class: 'faint' }, log.remarks[name] || ''));
}

/** Signals of a place that the map has; the others are offered below. */
function table(place, quantities, title) {
  const has = (quantity) => Object.keys(at([...place, quantity])).length > 0 || extra.has([...place, quantity].join('.'));
  const heads = ['signal', 'column, = a number, or a × b + …', 'unit', 'scale', '', 'why'].map((one) => h('th', { scope: 'col' }, one));
  const shown = quantities.filter(has);
  const others = quantities.filter((one) => !has(one));
  const add = h('select', { 'aria-label': `Signal to add to ${title}`, onchange: (event) => { extra.add([...place, event.target.value].join('.')); draw(); } },
    h('option', { value: '' }, 'add a signal…'), others.map((one) => h('option', { value: one }, MEANS[one] || one)));
  return [shown.length ? h('div', { class: 'scroll', tabindex: 0, role: 'group', 'aria-label': title }, h('table', { class: 'map' }, h('thead', {}, h('tr', {}, heads)),
    h('tbody', {}, shown.map((quantity) => row([...place, quantity], quantity, `${title} ${quantity}`, Boolean(at(place).gear_ratio)))))) : null, others.length ? add : null];
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
    const gear = h('label', {}, 'turns of the motor to one of the joint ', text(['drives', name], 'gear_ratio', name, '5rem'));
    return h('div', {}, h('div', { class: 'row' }, field, drop, gear), table(['drives', name], DRIVE, name));
  });
}

function time() {
  if (log.is_bag) return h('label', {}, 'time of ', pick(['time'], 'stamp', 'Time', [['header', 'the message’s header'], ['log', 'its arrival']]));
  const now = map.time || {};
  const kind = Object.keys(TIMES).find((one) => now[one]) || 'column';
  const changed = (value) => { map.time = { column: { column: '', unit: 's' }, columns: { columns: [{ from: '', unit: 's' }, { from: '', unit: 'ns' }] }, rate: { rate: 100 }, steady: { steady: true } }[value]; draw(); };
  const fields = {
    column: () => ['column', text(['time'], 'column', 'Time', '12rem', 'log-columns'), 'unit', text(['time'], 'unit', 'Time', '4rem')],
    columns: () => now.columns.map((_, index) => [text(['time', 'columns', index], 'from', `Time ${index + 1}`, '10rem', 'log-columns'), text(['time', 'columns', index], 'unit', `Time ${index + 1}`, '4rem')]),
    rate: () => [text(['time'], 'rate', 'Time', '5rem'), 'Hz'],
    steady: () => 'rows in any order; what needs time (inertia, delay, heat) is not offered',
  }[kind];
  return h('div', { class: 'row', 'data-place': 'time' }, h('label', {}, 'Time is ', h('select', { onchange: (event) => changed(event.target.value) }, Object.entries(TIMES).map(([value, words]) => h('option', { value, selected: value === kind }, words)))),
    fields(), h('span', { class: 'faint' }, log.remarks.time || ''));
}

const send = (preview) => { last = preview; return attempt(() => post('log', { file: log.file, map, preview })); };

function draw() {
  const ready = log.ready.map((one) => h('button', { type: 'button', onclick: () => { map = structuredClone(one.map); draw(); } }, `Use the ready map ${one.name}`));
  const columns = log.columns.map((one) => h('option', { value: one.address }, one.low == null ? '' : `${number(one.low)} … ${number(one.high)} ${one.unit}`));
  fill(parts.body, h('datalist', { id: 'log-columns' }, columns),
    h('h3', {}, `Map of ${short(log.file)}`), h('p', { class: 'faint' }, `${log.columns.length} columns. Guessed from their names: check the units, which torque it is, and the reasons on the right.`),
    ready.length ? h('div', { class: 'row' }, ready) : null, time(), drives(),
    h('h4', {}, 'Supply of the whole robot'), table(['supply'], SUPPLY, 'supply of the whole robot'),
    h('div', { class: 'row' }, h('p', { id: 'log-error', role: 'alert', class: 'none_of_the_above' }), h('span', { id: 'log-fix' })),
    h('div', { class: 'row' }, h('button', { type: 'button', class: 'work', onclick: () => send(true) }, 'Preview in SI units'), h('button', { type: 'button', class: 'work main', onclick: () => send(false) }, 'Import')),
    h('div', { id: 'log-result' }));
}

/** Buttons for what an error asks for: what it says to put into the map, or columns of volts. */
function fixes({ place, fix, error }) {
  const button = (label, work) => h('button', { type: 'button', onclick: () => { work(); draw(); send(last); } }, label);
  const put = () => { if (fix.key === 'unit') entry(['time']).unit = fix.value; else map.time = { [fix.key]: fix.value }; };
  if (fix) return [button(`Set the ${fix.key} to ${number(fix.value)}`, put)];
  if (!error.includes('without voltage')) return [];
  const volts = log.columns.filter((one) => one.unit === 'V' || /volt/i.test(one.address)).slice(0, 3);
  return volts.map((one) => button(`Take ${one.address} (${number(one.low)} … ${number(one.high)})`, () => { Object.assign(entry(place.split('.')), { from: one.address, unit: 'V' }); }));
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
  fill(find('log-fix'));
  fill(find('log-result'));
  if (!found) return;
  if (found.error) {
    const [outer, quantity] = [found.place.split('.').slice(0, -1), found.place.split('.').pop()];
    if ([...DRIVE, ...SUPPLY].includes(quantity) && !rowOf(found.place) && Object.keys(at(outer)).length) { extra.add(found.place); draw(); }
    const told = find('log-error');
    const node = found.place ? rowOf(found.place) : null;
    told.textContent = found.place ? `${found.place}: ${found.error}` : found.error;
    fill(find('log-fix'), fixes(found));
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
    h('tbody', {}, found.signals.map((one) => h('tr', {}, h('td', {}, one.drive || 'supply'), h('td', {}, one.quantity.replace('_', ' '), found.computed[one.drive] && ['power', 'current'].includes(one.quantity) ? h('span', { class: 'limit' }, 'computed') : null), h('td', { class: 'number' }, number(one.low)), h('td', { class: 'number' }, number(one.high)), h('td', {}, one.unit), h('td', {}, sparkline(one))))))),
  Object.entries(found.computed).map(([drive, formula]) => h('p', { class: 'warning' }, `The power of ${drive} is computed by the firmware as ${formula}: its losses are not in it, and nothing is metered.`)),
  found.notes.map((note) => h('p', {}, `${note}.`)), command(found.command));
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
