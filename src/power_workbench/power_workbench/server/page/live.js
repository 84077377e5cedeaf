// Live: measured power, the model's estimate and their difference, the budget of the last seconds; notes.

import { stacked } from './budget.js';
import { attempt, bench, choices, fill, find, h, number, post, quantity, watts } from './dom.js';
import { modelFiles, shortened } from './model.js';
import { color, draw } from './plot.js';

const KEPT = 30; // s
const SUM = 'sum';
let parts = null;
let source = null;
let rows = { t: [], names: [], measured: [], estimate: [] };
let state = null;
let drive = SUM;
let model = '';
let picked = false;
let wanted = false;
let due = 0;
let accounted = 0;
let battery = null; // Wh that are left, and when

export function start() {
  const follow = h('button', { type: 'button', class: 'main', 'aria-pressed': 'false', onclick: () => { wanted = !wanted; connect(); } }, 'Follow the running robot');
  const pick = h('select', { 'aria-label': 'Model to compare with', onchange: (event) => { picked = true; model = event.target.value; if (wanted) connect(); } });
  const said = h('div', { id: 'live-said', role: 'status' });
  const body = h('div', { hidden: true });
  const drives = h('div', { id: 'live-drives' });
  const now = h('p', { class: 'verdict', id: 'live-now' });
  const plot = h('div', { class: 'plot traces', id: 'plot-live' });
  const goes = h('div', { class: 'plot', id: 'plot-live-budget' });
  const legend = h('ul', { class: 'legend' });
  const hours = h('span', { id: 'live-hours' });
  const charge = h('input', { type: 'number', min: 0, step: 'any', 'aria-label': 'Energy in the battery now, in Wh', oninput: (event) => { battery = event.target.value === '' ? null : { left: Number(event.target.value), at: performance.now() }; lasting(); } });
  const budget = h('div', {}, h('h3', {}, 'Where the power goes'), h('p', { class: 'faint' }, 'Means of the last ten seconds.'), legend, goes,
    h('div', { class: 'row' }, h('label', {}, 'In the battery now ', charge, ' Wh'), hours));
  const bars = h('div', { class: 'plot', id: 'plot-live-bars' });
  const each = h('div', {}, h('h3', {}, 'Drives'), h('p', { class: 'faint' }, 'Means of the last second.'), bars);
  const heard = h('p', { class: 'faint', id: 'live-heard' });
  const text = h('input', { type: 'text', id: 'live-note', maxlength: 500, 'aria-label': 'Note', placeholder: 'left foot slipped' });
  const kept = h('p', { class: 'faint', id: 'live-kept', role: 'status' });
  const mark = h('form', { class: 'row', onsubmit: note }, text, h('button', { type: 'submit' }, 'Put a note with its time'));
  parts = { follow, pick, said, body, drives, now, plot, budget, goes, legend, hours, bars, each, heard, text, kept };
  fill(body, drives, now, plot, budget, each, h('h3', {}, 'Note'), mark, kept, heard);
  fill(find('live-body'), h('div', { class: 'row' }, follow, h('label', {}, 'beside ', pick)), said, body);
  document.addEventListener('visibilitychange', connect);
  update();
}

/** Models that there are to compare with. */
export function update() {
  if (!parts) return;
  const own = bench.state && bench.state.model;
  const options = [['', own ? `the model of the recordings, ${bench.state.model.name}` : 'the model of the recordings, once there is one'], ['topic', 'the topic power_estimate'],
    ...modelFiles().map((file) => [file, shortened(file)])];
  if (!picked && !wanted) model = own ? '' : 'topic';
  fill(parts.pick, options.map(([value, label]) => h('option', { value, selected: value === model }, label)));
}

function connect() {
  const on = wanted && !document.hidden;
  if (source) source.close();
  source = null;
  parts.follow.setAttribute('aria-pressed', String(wanted));
  parts.follow.textContent = wanted ? 'Follow no longer' : 'Follow the running robot';
  parts.follow.className = wanted ? '' : 'main';
  parts.body.hidden = !wanted;
  if (!wanted) { fill(parts.said); state = null; }
  if (!on) return;
  rows = { t: [], names: [], measured: [], estimate: [] };
  if (!state) fill(parts.said, h('p', {}, 'Listening…'));
  source = new EventSource(`/api/sessions/${bench.session}/live?${new URLSearchParams({ model })}`);
  source.onmessage = (event) => take(JSON.parse(event.data));
}

function take(news) {
  if (news.failed) {
    wanted = false;
    connect();
    fill(parts.said, h('p', {}, news.failed));
    return;
  }
  state = news;
  if (news.t.length) keep(news);
  const begun = performance.now();
  if (begun < due) return;
  render();
  // Where drawing is slow it is done less often, so that the page still answers.
  due = performance.now() + Math.max(180, 2 * (performance.now() - begun));
}

/** Join new rows to those of the last half minute; drives that are new begin with gaps. */
function keep(news) {
  const names = [...news.names, SUM];
  const blank = () => rows.t.map(() => null);
  const back = rows.t.length && news.t[0] < rows.t[rows.t.length - 1];
  if (back) rows = { t: [], names: [], measured: [], estimate: [] };
  const before = rows;
  const columns = (key) => names.map((name, index) => {
    const old = before.names.indexOf(name);
    return [...(old < 0 ? blank() : before[key][old]), ...news[key][index]];
  });
  rows = { names, t: [...before.t, ...news.t], measured: columns('measured'), estimate: columns('estimate') };
  const first = rows.t.findIndex((time) => time > rows.t[rows.t.length - 1] - KEPT);
  if (first > 50) {
    rows.t = rows.t.slice(first);
    for (const key of ['measured', 'estimate']) rows[key] = rows[key].map((column) => column.slice(first));
  }
}

const mean = (values) => {
  const known = values.filter((value) => value != null);
  return known.length ? known.reduce((a, b) => a + b, 0) / known.length : null;
};

/** Means of the last second of a drive: measured and estimated. */
function latest(index) {
  const from = rows.t.findIndex((time) => time > rows.t[rows.t.length - 1] - 1);
  return [mean(rows.measured[index].slice(from)), mean(rows.estimate[index].slice(from))];
}

/** Text whose parts between backticks are commands. */
const coded = (text) => text.split('`').map((part, index) => (index % 2 ? h('code', {}, part) : part));

function changed(node, text) { if (node.textContent !== text) node.textContent = text; }

function render() {
  const said = [...state.said, ...state.faults];
  const shown = [...parts.said.children].map((one) => one.textContent);
  // Seconds that pass are no news to who listens.
  const plain = (text) => text.replace(/\d+ s\b/, '').replaceAll('`', '');
  if (said.map(plain).join('\n') !== shown.map(plain).join('\n')) fill(parts.said, said.map((text) => h('p', {}, coded(text))));
  changed(parts.heard, `Heard: ${Object.entries(state.heard).filter(([, one]) => one.age != null).map(([topic, one]) => `${topic} ${number(one.rate)} Hz`).join(', ') || 'nothing yet'}.`
    + (state.recorder ? ` Recording to ${state.recorder}.` : ' Nothing is recorded.'));
  if (performance.now() > accounted + 1000) goes();
  const none = !rows.t.length;
  for (const node of [parts.drives, parts.now, parts.plot, parts.each]) node.hidden = none;
  if (none) return;
  if (!rows.names.includes(drive)) drive = SUM;
  if (parts.drives.dataset.names !== rows.names.join(' ')) {
    parts.drives.dataset.names = rows.names.join(' ');
    fill(parts.drives, choices('Drive', 'live-drive', rows.names.map((name) => ({ value: name, label: name })), drive, (name) => { drive = name; render(); }));
  }
  const index = rows.names.indexOf(drive);
  const [measured, estimate] = latest(index);
  changed(parts.now, `${drive}: measured ${watts(measured)}${estimate == null ? '' : `, model ${watts(estimate)}, error ${watts(estimate - measured)}`}`);
  traces(index, estimate != null || rows.estimate[index].some((value) => value != null));
  levels();
}

/** Parts of the power of the last ten seconds, and how long the battery lasts at it. */
function goes() {
  accounted = performance.now();
  const found = Object.entries(state.budget.parts).map(([effect, mean_w]) => ({ effect, mean_w }));
  parts.budget.hidden = !found.length;
  if (!found.length) return;
  stacked(parts.goes, parts.legend, 'Mean power of the last ten seconds', [['power', found]]);
  lasting();
}

function lasting() {
  const metered = state && state.budget.metered_w;
  if (battery && metered != null) {
    const now = performance.now();
    battery = { left: Math.max(battery.left - (metered * (now - battery.at)) / 3.6e6, 0), at: now };
  }
  changed(parts.hours, battery && metered > 0 ? `${quantity(battery.left / metered, 'h')} left at ${watts(metered)}` : '');
}

function traces(index, two) {
  const end = rows.t[rows.t.length - 1];
  const t = rows.t.map((time) => time - end);
  const line = (y, name, tone, axis, width) => ({ x: t, y, name, type: 'scatter', mode: 'lines', yaxis: axis, line: { color: color(tone), width }, hovertemplate: `%{y:.1f} W<extra>${name}</extra>` });
  const measured = rows.measured[index];
  const estimate = rows.estimate[index];
  const error = measured.map((value, at) => (value == null || estimate[at] == null ? null : estimate[at] - value));
  draw(parts.plot, `Power of ${drive} in the last ${KEPT} seconds: measured, model, and the error below.`, () => [[
    line(measured, 'measured', 'measured', 'y', 2),
    ...(two ? [line(estimate, 'model', 'base', 'y', 1.4), { ...line(error, 'error (model − measured)', 'base', 'y2', 1.2), showlegend: false }] : []),
  ], {
    showlegend: true, margin: { l: 58, r: 12, t: 30, b: 42 }, dragmode: false,
    xaxis: { title: { text: 'time before now in s' }, range: [-KEPT, 0], fixedrange: true, anchor: two ? 'y2' : 'y' },
    yaxis: { title: { text: 'power in W' }, domain: two ? [0.42, 1] : [0, 1], fixedrange: true, autorange: true },
    ...(two ? { yaxis2: { title: { text: 'error in W' }, domain: [0, 0.36], fixedrange: true, autorange: true, zeroline: true } } : {}),
  }]);
}

function levels() {
  const names = rows.names.filter((name) => name !== SUM);
  const pairs = names.map((_, index) => latest(index));
  parts.bars.style.height = `${Math.max(9, 5 + 2.1 * names.length)}rem`;
  const bar = (column, name, tone) => ({ type: 'bar', orientation: 'h', y: names, x: pairs.map((pair) => pair[column]), name, marker: { color: color(tone) }, hovertemplate: '%{y}: %{x:.1f} W<extra></extra>' });
  const words = names.map((name, index) => `${name} ${watts(pairs[index][0])}`).join(', ');
  draw(parts.bars, `Power of the drives, measured and model: ${words}.`, () => [
    [bar(0, 'measured', 'measured'), ...(pairs.some((pair) => pair[1] != null) ? [bar(1, 'model', 'base')] : [])],
    { showlegend: true, barmode: 'group', bargap: 0.3, margin: { l: 84, r: 12, t: 30, b: 42 }, dragmode: false, xaxis: { title: { text: 'power in W' }, fixedrange: true }, yaxis: { autorange: 'reversed', type: 'category', fixedrange: true } },
  ]);
}

async function note(event) {
  event.preventDefault();
  const text = parts.text.value.trim();
  const found = await attempt(() => post('note', { text }));
  if (!found) return;
  parts.text.value = '';
  parts.kept.textContent = found.recording ? `“${text}” is in the card of ${found.recording}.` : `“${text}” is in notes.yaml of this session; nothing is being recorded.`;
}
