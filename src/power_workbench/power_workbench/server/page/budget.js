// Where the power goes: bars by drive, phase or recording, flows, what would change it, hours.

import { attempt, bench, choices, command, download, fill, find, get, h, percent, quantity, watts, whisker } from './dom.js';
import { motion } from './motion.js';
import { color, draw, keys, ofFamily, pictures } from './plot.js';

const ALL = 'all';
const LEAST = 0.002; // of the power, that is drawn as a flow
let known = null;
let found = null;
let parts = null;
let by = '';
let member = '';

const words = (name) => (name === 'payload' ? 'weight to carry' : name.replaceAll('_', ' '));

function build() {
  parts = {
    origin: h('p', { class: 'faint' }), ways: h('div', { class: 'row' }), bars: h('div', { class: 'plot', id: 'plot-budget' }),
    flow: h('div', { class: 'plot', id: 'plot-flow' }), uncertain: h('div', { class: 'pair' }), levers: h('div'), table: h('div'), more: h('div', { class: 'row' }),
    hours: h('span', { role: 'status' }), legend: h('ul', { class: 'legend' }), apart: h('div'), motion: h('div', { class: 'pair' }),
  };
  parts.battery = h('input', { type: 'number', min: 0, step: 'any', 'aria-label': 'Battery in Wh', oninput: hours });
  fill(find('budget-body'), parts.origin, parts.ways, h('div', { class: 'pair' }, h('div', {}, parts.legend, parts.bars, h('p', { class: 'faint' }, 'A bar\'s parts add up to the mark: those left of 0 are given back.')), parts.flow), parts.uncertain, parts.motion, parts.apart, parts.more);
  fill(parts.uncertain, parts.levers, h('div', {}, h('h3', {}, 'How long a battery lasts'), h('div', { class: 'row' }, h('label', {}, 'Battery ', parts.battery, ' Wh'), parts.hours), parts.table));
}

export async function update() {
  const { budget, opened, at, view } = bench.state;
  find('budget').hidden = !view || view.share < 1;
  find('budget-body').setAttribute('aria-busy', String(!budget.headline || Boolean(budget.first)));
  if (!budget.headline) {
    const words_ = budget.error ? `No budget: ${budget.error}.` : 'Working out where the power goes, beside whatever else is done…';
    if (parts) { parts.origin.textContent = words_; certain(false); }
    else fill(find('budget-body'), h('p', {}, words_), budget.error ? null : h('progress', { 'aria-label': 'Working out the budget' }));
    return;
  }
  const now = JSON.stringify([budget, at, opened]);
  if (now === known) return;
  known = now;
  const news = await attempt(() => get('budget'));
  if (!news || !news.rows) return;
  found = news;
  if (!parts) build();
  render();
  if (!found.first) motion(parts.motion, found, bench.known.families);
}

/** What a first look, or an error, leaves open is hidden. */
function certain(known_) {
  for (const node of [parts.uncertain, parts.motion, parts.apart, parts.more]) node.hidden = !known_;
}

/** Rows of the shown member by what the bars stand for: their name and parts. */
function groups() {
  const { drives, meters } = bench.state.view;
  const own = (name, phase = ALL, rows = found.rows) => rows.filter((row) => row.drive === name && row.phase === phase);
  const every = [...new Set(found.rows.map((row) => row.drive))];
  const single = new Set([...drives, ...meters]);
  const kinds = every.filter((name) => name !== found.robot && !single.has(name));
  const ways = { 'drive type': kinds, drive: every.filter((name) => name !== found.robot && single.has(name)) };
  const lists = {};
  const apart = own(found.robot).filter((row) => row.effect === 'electronics');
  const beside = apart.length ? [['electronics', apart]] : [];
  for (const [way, names] of Object.entries(ways)) if (names.length > 1) lists[way] = [...names.map((name) => [name, own(name)]), ...beside];
  const phases = [...new Set(found.rows.map((row) => row.phase))].filter((phase) => own(member, phase).length);
  if (phases.length > 1) lists['phase of the motion'] = phases.map((phase) => [phase === ALL ? 'all phases' : phase, own(member, phase)]);
  if (found.recordings) lists.recording = found.recordings.map((one) => [one.name, own(member, ALL, one.rows)]);
  return { lists, whole: own(member) };
}

const family = (effect) => bench.known.families.find((one) => one.effects.includes(effect)) || bench.known.families.find((one) => one.name === 'other');

/** W by family. */
function summed(rows) {
  const out = new Map(bench.known.families.map((one) => [one, 0]));
  for (const row of rows) out.set(family(row.effect), out.get(family(row.effect)) + row.mean_w);
  return [...out].filter(([, value]) => value);
}

function render() {
  const names = [...new Set(found.rows.map((row) => row.drive))];
  if (!names.includes(member)) member = found.robot;
  const { lists, whole } = groups();
  if (!lists[by]) [by] = Object.keys(lists);
  const intervals = found.first ? 'Intervals, and what would change it, follow…' : 'Intervals are of 90 %; where the model lacks an effect, they hold less often.';
  const { recordings, seconds } = bench.state.view;
  parts.origin.textContent = `${recordings.map((path) => path.split('/').pop()).join(', ')}, ${Math.round(seconds)} s. ${found.chosen ? 'A model that the page chose' : 'By the present model'}: ${words(found.origin)}. ${intervals}`;
  fill(parts.ways,
    by ? choices('Bars by', 'budget-by', Object.keys(lists).map((way) => ({ value: way, label: way })), by, (way) => { by = way; render(); }) : null,
    names.length > 1 ? h('label', {}, 'flows and parts of ', h('select', { onchange: (event) => { member = event.target.value; render(); } }, names.map((name) => h('option', { value: name, selected: name === member }, name)))) : null);
  stacked(parts.bars, parts.legend, `Mean power by ${by || 'part'}`, by ? lists[by] : [[member, whole]]);
  flow(whole);
  certain(!found.first);
  if (found.first) return;
  levers();
  table(whole);
  differences();
  hours();
  fill(parts.more, pictures(parts.bars, 'budget', 'Bars', () => ({ showlegend: true })), pictures(parts.flow, 'flow', 'Flows'), h('button', { type: 'button', onclick: csv }, 'CSV'), command(bench.state.commands.budget));
}

/** Stacked bars of names with their parts { effect, mean_w }; legend says what is what. */
export function stacked(node, legend, title, list) {
  const labels = list.map(([name]) => name);
  const sums = list.map(([, rows]) => new Map(summed(rows)));
  const metered = list.map(([, rows]) => rows.reduce((sum, row) => sum + row.mean_w, 0));
  const seen = bench.known.families.filter((one) => sums.some((own) => Math.abs(own.get(one) || 0) > 1e-3));
  keys(legend, seen);
  node.style.height = `${5.5 + 2.1 * list.length}rem`;
  draw(node, `${title}: ${labels.map((name, index) => `${name} ${watts(metered[index])}`).join(', ')}.`, () => [[
    ...seen.map((one) => ({
      type: 'bar', orientation: 'h', y: labels, x: sums.map((own) => own.get(one) || 0), name: one.words,
      marker: { color: ofFamily(one), pattern: one.name === 'unexplained' ? { shape: '/', size: 6 } : undefined }, hovertemplate: `%{y}: %{x:.3~g} W<extra>${one.words}</extra>`,
    })),
    { type: 'scatter', mode: 'markers', name: 'metered', y: labels, x: metered, marker: { symbol: 'line-ns', size: 22, line: { width: 3, color: color('text') } }, hovertemplate: '%{y}: %{x:.3~g} W metered<extra></extra>' },
  ], {
    barmode: 'relative', bargap: 0.3, margin: { l: 10, r: 12, t: 10, b: 42 },
    xaxis: { title: { text: 'mean power in W' }, fixedrange: true, zeroline: true }, yaxis: { autorange: 'reversed', type: 'category', automargin: true, fixedrange: true },
  }]);
}

/** Flows from the supply, and from joints that give back, to where the power ends. */
function flow(rows) {
  const sums = summed(rows);
  const metered = rows.reduce((sum, row) => sum + row.mean_w, 0);
  const tone = (one) => () => ofFamily(one);
  const least = LEAST * sums.reduce((sum, [, value]) => sum + Math.max(value, 0), 0);
  const label = (name, value) => `${name.replace(/(.{13}\S*) /, '$1<br>')}<br>${watts(value)}${metered > 0 ? `, ${percent(value / metered)}` : ''}`;
  const flows = (list) => list.map(([name, value, colour]) => ({ value, colour, text: label(name, value) }));
  const sources = flows([['metered', metered, () => color('measured')], ...sums.filter(([, value]) => value < -least).map(([one, value]) => [one.words, -value, tone(one)])]);
  const sinks = flows(sums.filter(([, value]) => value > least).map(([one, value]) => [one.words, value, tone(one)]));
  parts.flow.style.height = `${4 + 3.8 * Math.max(sinks.length, 5)}rem`;
  draw(parts.flow, `Flows of ${member}: ${[...sources, ...sinks].map((one) => one.text.replaceAll('<br>', ' ')).join('; ')}.`, () => ribbons(sources, sinks));
}

/** Ribbons from sources to a bar, and on to sinks, with the labels outside. */
function ribbons(sources, sinks) {
  const total = sinks.reduce((sum, one) => sum + one.value, 0) || 1;
  const apart = (1.2 * total) / Math.max(sinks.length, 4);
  const shapes = [{ type: 'rect', x0: 0.44, x1: 0.48, y0: 0, y1: total, fillcolor: color('measured'), opacity: 0.8, line: { width: 0 } }];
  const [annotations, ends] = [[], [0, total]];
  for (const [flows, near, far, gap, anchor, side] of [[sources, 0.44, 0, 1.6 * apart, 'right', -5], [sinks, 0.48, 1, apart, 'left', 5]]) {
    const middle = 0.5 * (near + far);
    let level = 0;
    let at = -0.5 * gap * (flows.length - 1);
    for (const { value, colour, text } of flows) {
      shapes.push({ type: 'path', fillcolor: colour(), opacity: 0.9, line: { width: 0 }, path: `M${near},${level}C${middle},${level} ${middle},${at} ${far},${at}L${far},${at + value}C${middle},${at + value} ${middle},${level + value} ${near},${level + value}Z` });
      annotations.push({ x: far, y: at + 0.5 * value, xanchor: anchor, xshift: side, align: anchor, showarrow: false, text, font: { color: color('text'), size: 12 } });
      ends.push(at, at + value);
      level += value;
      at += value + gap;
    }
  }
  return [[{ type: 'scatter', x: [0, 1], y: [0, total], mode: 'markers', marker: { opacity: 0 }, hoverinfo: 'skip' }], {
    shapes, annotations, margin: { l: 104, r: 126, t: 18, b: 18 }, dragmode: false,
    xaxis: { visible: false, range: [0, 1], fixedrange: true }, yaxis: { visible: false, range: [Math.max(...ends) + 0.3 * apart, Math.min(...ends) - 0.3 * apart], fixedrange: true },
  }];
}

const CHANGED = /^(\w+)=([\d.]+)$/;
function changed(change) {
  const [, name, factor] = CHANGED.exec(change) || [null, change, 1];
  const by10 = Math.round(100 * (factor - 1));
  return `${words(name)} ${by10 < 0 ? `−${-by10}` : `+${by10}`} %`;
}

function levers() {
  const range = [Math.min(0, ...found.levers.map((one) => one.interval[0])), Math.max(0, ...found.levers.map((one) => one.interval[1]))];
  const sorted = found.levers.filter((one) => one.interval[0] || one.interval[1]).sort((a, b) => a.mean_w - b.mean_w);
  const idle = found.levers.filter((one) => !sorted.includes(one)).map((one) => changed(one.change));
  fill(parts.levers, h('h3', {}, 'What would change it'), sorted.length ? h('table', {},
    h('caption', {}, 'Of the mean power, at the same motion of the joints, with 90 % intervals; to the left saves. Weight to carry is that of robot and load'),
    h('tbody', {}, sorted.map((one) => { const shown = whisker(one.mean_w, one.interval, range, 'W'); return h('tr', {}, h('th', { scope: 'row' }, changed(one.change)), h('td', { class: 'number' }, signed(one.mean_w)), h('td', { class: 'number faint wide-only' }, shown.title), h('td', {}, shown)); }))) : null,
  idle.length ? h('p', { class: 'faint' }, `Nothing by this model: ${idle.join(', ')}.`) : null, found.refused.map((reason) => h('p', { class: 'faint' }, `Not carried over: ${reason}.`)));
}

const signed = (value) => `${value < 0 ? '−' : '+'}${watts(Math.abs(value))}`;

function table(rows) {
  const sorted = [...rows].sort((a, b) => (a.effect === 'unexplained') - (b.effect === 'unexplained') || b.mean_w - a.mean_w);
  const range = [Math.min(0, ...rows.map((row) => row.interval[0])), Math.max(...rows.map((row) => row.interval[1]))];
  fill(parts.table, h('details', {}, h('summary', {}, `Parts of ${member} with their intervals`), h('table', {}, h('tbody', {},
    sorted.map((row) => h('tr', {}, h('th', { scope: 'row' }, words(row.effect)), h('td', { class: 'number' }, watts(row.mean_w)), h('td', { class: 'number' }, percent(row.share)), h('td', {}, whisker(row.mean_w, row.interval, range, 'W'))))))));
}

/** What each recording draws more than the first, by part. */
function differences() {
  const rows = (found.differences || []).filter((row) => row.drive === member && row.phase === ALL);
  if (!rows.length) { fill(parts.apart); return; }
  const range = [Math.min(0, ...rows.map((row) => row.interval[0])), Math.max(0, ...rows.map((row) => row.interval[1]))];
  const sorted = rows.sort((a, b) => a.recording.localeCompare(b.recording) || Math.abs(b.mean_w) - Math.abs(a.mean_w));
  fill(parts.apart, h('h3', {}, `${member}: more than in ${rows[0].against}`), h('table', {}, h('tbody', {}, sorted.map((row) => h('tr', {}, h('th', { scope: 'row' }, `${row.recording}: ${words(row.effect)}`), h('td', { class: 'number' }, signed(row.mean_w)), h('td', {}, whisker(row.mean_w, row.interval, range, 'W')))))));
}

/** Hours of a battery at the mean metered power. */
function hours() {
  const size = Number(parts.battery.value);
  const rows = found.rows.filter((row) => row.drive === found.robot && row.phase === ALL);
  const metered = rows.reduce((sum, row) => sum + row.mean_w, 0);
  parts.hours.textContent = size > 0 && metered > 0 ? `lasts ${quantity(size / metered, 'h')} of this motion` : '';
}

function csv() {
  const rows = (found.recordings || [{ name: bench.state.view.recordings[0], rows: found.rows }]).flatMap((one) => one.rows.map((row) => [one.name, row.drive, row.phase, row.effect, row.mean_w, ...row.interval, row.share, row.energy_wh].join(',')));
  download('budget.csv', `recording,drive,phase,effect,mean_w,low_w,high_w,share,energy_wh\n${rows.join('\n')}\n`);
}
