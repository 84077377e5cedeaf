// What is missing: the verdict, candidates with a preview of the error, the staircase.

import { attempt, bench, command, fill, find, getArrays, h, number, post, take, watts } from './dom.js';
import * as discover from './discover.js';
import { color, draw } from './plot.js';
import { place, render as renderTraces } from './traces.js';

const KINDS = { named: 'Named', ambiguous: 'Ambiguous', none_of_the_above: 'None of the above', no_evidence: 'No evidence' };
let turn = 0;

export function update() {
  const { state } = bench;
  const found = state.diagnosis;
  const busy = Boolean(state.job);
  const begin = h('button', { type: 'button', class: found ? '' : 'main', disabled: busy || !state.model, onclick: () => attempt(() => post('diagnose')) }, found ? 'Diagnose again' : 'Find what is missing');
  if (!found) {
    fill(find('missing-body'), h('div', { class: 'row' }, begin), command(state.commands.diagnose), state.learned && state.model ? discover.section() : null);
    if (state.learned) discover.drawShapes();
    return;
  }
  fill(find('missing-body'), verdict(state, found), candidates(state, found), measurement(found), command(state.commands.diagnose), discover.section());
  discover.drawShapes();
}

function verdict(state, found) {
  const active = new Set(state.model.effects.map((effect) => effect.name));
  const named = found.effects.filter((name) => !active.has(name));
  const add = named.map((name) => h('button', { type: 'button', class: 'main', disabled: Boolean(state.job), onclick: () => take({ kind: 'add', effects: [name] }) }, `Add ${wordsOf(found, name)}`));
  const next = {
    named: 'Add it: all coefficients are fitted anew and the staircase below takes a step.',
    ambiguous: 'The recording cannot tell these apart. Add one to see what it does, or record the motion below, which can.',
    none_of_the_above: 'No effect of the catalogue explains it. Look at the map for its shape, or let discover learn it.',
    no_evidence: 'Nothing is missing that this recording could show. The motion below would show more.',
  }[found.verdict];
  return h('div', {}, h('p', { class: `kind ${found.verdict}` }, KINDS[found.verdict]), h('p', { class: 'verdict', id: 'verdict' }, found.sentence), h('p', {}, next), h('div', { class: 'row' }, add));
}

const wordsOf = (found, name) => (found.candidates.find((one) => one.name === name) || { words: name }).words;

function candidates(state, found) {
  const top = Math.max(...found.candidates.map((one) => one.delta_rmse_w), 1e-9);
  const groups = new Map();
  for (const one of found.candidates) {
    const key = [...one.family.split('/')].sort().join('/');
    groups.set(key, [...(groups.get(key) || []), one]);
  }
  const parts = [];
  for (const [family, rows] of groups) {
    if (family.includes('/')) parts.push(h('p', { class: 'tie faint' }, `No recording like this one can tell these apart: ${family.split('/').map((name) => wordsOf(found, name)).join(' = ')}`));
    for (const one of rows) parts.push(row(state, one, top));
  }
  return h('div', {}, h('h3', {}, 'Candidates'),
    h('p', { class: 'faint' }, 'By how much the error on held-out data falls with each, on average over the drives. Coloured ones may be the best; the others are ruled out.'),
    found.judged_on_s < found.of_s - 1 ? h('p', { class: 'faint' }, `Judged on ${found.judged_on_s.toFixed(0)} of ${found.of_s.toFixed(0)} s, in pieces spread evenly over the recording; a preview is drawn in these.`) : null,
    h('div', { id: 'candidates' }, parts));
}

function row(state, one, top) {
  const fall = Math.max(one.delta_rmse_w, 0);
  const bar = h('div', { class: 'fill' });
  bar.style.width = `${(100 * fall) / top}%`;
  const seen = state.previews.includes(one.name);
  const button = h('button', { type: 'button', disabled: Boolean(state.job), 'aria-label': `Add ${one.words}`, onclick: () => take({ kind: 'add', effects: [one.name] }) }, 'Add');
  const node = h('div', { class: `candidate${one.in_confidence_set ? ' in' : ''}`, 'data-preview': seen },
    h('span', {}, one.words, one.in_confidence_set ? h('small', {}, ' may be it') : null),
    h('div', { class: 'track', 'aria-hidden': 'true' }, bar),
    h('span', { class: 'falls' }, `${fall.toFixed(3)} W`),
    h('small', { class: 'value' }, `${one.symbol} = ${number(one.coefficient)}${one.at_bound ? '*' : ''} ${one.unit === '1' ? '' : one.unit} (${number(one.interval[0])} … ${number(one.interval[1])}, ${one.drive})`),
    one.name === 'torque_bias' ? h('span') : button);
  if (seen) {
    node.addEventListener('mouseenter', () => preview(one));
    node.addEventListener('mouseleave', () => preview(null));
    node.addEventListener('focusin', () => preview(one));
    node.addEventListener('focusout', () => preview(null));
  }
  return node;
}

async function preview(one) {
  const mine = ++turn;
  if (!one) {
    bench.preview = null;
    renderTraces();
    return;
  }
  const found = await attempt(() => getArrays('preview', { candidate: one.name, ...place() }));
  if (!found || mine !== turn) return;
  bench.preview = { ...found, words: one.words };
  renderTraces();
}

function measurement(found) {
  const rows = Object.entries(found.measurement).map(([name, term]) => h('tr', {},
    h('td', {}, name.replaceAll('_', ' ')), h('td', { class: 'number' }, `${number(term.value)} ${term.unit === '1' ? '' : term.unit}`),
    h('td', { class: 'number' }, watts(term.watts)), h('td', {}, term.matters ? 'yes' : 'no')));
  const head = ['error of the measurement', 'value', 'would cost', 'matters'].map((text, index) => h('th', { scope: 'col', class: index === 1 || index === 2 ? 'number' : '' }, text));
  return h('details', {}, h('summary', {}, 'Is the measurement sound?'), h('div', { class: 'scroll', tabindex: 0, role: 'group', 'aria-label': 'Errors of the measurement' }, h('table', {}, h('thead', {}, h('tr', {}, head)), h('tbody', {}, rows))));
}

/** A form that draws another model as a line. */
function other() {
  const field = h('input', { type: 'text', 'aria-label': 'Another model', placeholder: 'ppn:RUN or mechanical_power' });
  const go = (event) => { event.preventDefault(); attempt(() => post('line', { model: field.value.trim() })); };
  return h('form', { class: 'row', onsubmit: go }, 'Draw another model as a line', field, h('button', { type: 'submit' }, 'Compare'));
}

export function stairs() {
  const { stairs: steps, view } = bench.state;
  const lines = [['meter’s noise', view.noise_w, 'dot'], ...(bench.state.lines || []).map((one) => [one.name, one.rmse_w, 'dash'])].filter(([, level]) => level != null);
  const body = find('stairs-body');
  if (!find('plot-stairs')) fill(body, h('div', { class: 'plot low', id: 'plot-stairs' }), h('p', { id: 'stairs-words' }),
    h('p', { class: 'faint' }, 'The steps judge each model as it is. The verdict above allows for errors of the meter and for formulas that are not quite what a drive does, so that its figures are a little lower.'), other());
  const last = steps[steps.length - 1];
  const first = steps[0];
  find('stairs-words').textContent = steps.length > 1
    ? `From ${watts(first.rmse_w)} to ${watts(last.rmse_w)} in ${steps.length - 1} ${steps.length > 2 ? 'steps' : 'step'}; the meter’s noise is ${watts(view.noise_w)}.`
    : `The first model is ${watts(first.rmse_w)} off; the meter’s noise is ${watts(view.noise_w)}.`;
  const top = Math.max(...steps.map((one) => one.rmse_w), ...lines.map(([, level]) => level));
  draw(find('plot-stairs'), find('stairs-words').textContent, () => [[{
    type: 'bar', x: steps.map((_, index) => index), y: steps.map((one) => one.rmse_w), text: steps.map((one) => watts(one.rmse_w)), textposition: 'outside', cliponaxis: false,
    marker: { color: steps.map((_, index) => color(index ? 'better' : 'base')) }, hovertemplate: '%{y:.3f} W<extra></extra>',
  }], {
    bargap: 0.5, margin: { l: 58, r: 12, t: 16, b: 64 },
    xaxis: { range: [-0.6, steps.length + 0.1], tickvals: steps.map((_, index) => index), ticktext: steps.map((one, index) => (index ? one.label : 'first model').replace(/(.{18}\S*) /g, '$1<br>')), fixedrange: true },
    yaxis: { title: { text: 'held-out error in W' }, range: [0, 1.2 * top], fixedrange: true },
    shapes: lines.map(([, level, dash]) => ({ type: 'line', xref: 'paper', x0: 0, x1: 1, y0: level, y1: level, line: { color: color('faint'), dash } })),
    annotations: lines.map(([name, level]) => ({ xref: 'paper', x: 1, xanchor: 'right', y: level, yanchor: 'bottom', showarrow: false, text: `${name} ${watts(level)}`, font: { color: color('text') } })),
  }]);
}
