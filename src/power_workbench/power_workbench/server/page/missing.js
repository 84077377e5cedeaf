// What is missing: candidates with a preview of the error, errors of the measurement, the staircase.

import { attempt, bench, command, fill, find, getArrays, h, percent, plural, post, quantity, take, watts, whisker } from './dom.js';
import * as discover from './discover.js';
import { modelFiles, shortened } from './model.js';
import { color, draw } from './plot.js';
import { place, render as renderTraces } from './traces.js';

const NOTHING = 0.01; // of the error, that is worth no row
const UNLIKELY = 0.05; // probability
let turn = 0;

export function update() {
  const { state } = bench;
  const found = state.diagnosis;
  find('missing').hidden = !state.model || !(found || state.learned);
  if (find('missing').hidden) return;
  fill(find('missing-body'), found ? [candidates(state, found), measurement(found), h('details', {}, h('summary', {}, 'The same as a command'), command(state.commands.diagnose))] : [], discover.section());
  discover.drawShapes();
}

const isPlausible = (one) => one.probability >= UNLIKELY;
const rms = (values) => Math.sqrt(values.reduce((sum, value) => sum + value * value, 0) / Math.max(values.length, 1));
const nameOf = (found, name) => (found.candidates.find((one) => one.name === name) || { words: name }).words;

function candidates(state, found) {
  const own = Object.values(found.drives);
  const scale = { error: rms(own.map((one) => one.rmse_w)), noise: rms(own.map((one) => one.sensor_noise_w).filter((value) => value != null)) };
  const best = (one) => Math.max(one.delta_rmse_w, one.explains_w);
  const shown = found.candidates.filter((one) => isPlausible(one) || best(one) >= NOTHING * scale.error);
  const [plausible, others] = [true, false].map((inside) => shown.filter((one) => isPlausible(one) === inside));
  const named = found.verdict === 'named' ? plausible.filter((one) => found.effects.includes(one.name)) : [];
  const none = found.candidates.filter((one) => !shown.includes(one)).map((one) => one.words);
  const tied = [...new Set(plausible.map((one) => one.family).filter((family) => family.includes('/')))];
  const rows = (list) => list.map((one) => row(state, found, one, scale));
  return h('div', {},
    h('p', { class: 'faint' }, `Bars: part of the error of ${watts(scale.error)} that goes with the effect alone (dark), and that no effect of the model explains (light); hatched: the meter’s noise. Point at one to preview the error with it.`),
    found.notes.map((note) => h('p', { class: 'faint note' }, note.replaceAll('`', ''))),
    tied.map((family) => h('p', { class: 'tie faint' }, `This recording cannot tell these apart: ${family.split('/').map((name) => nameOf(found, name)).join(', ')}.`)),
    h('div', { id: 'candidates' },
      [['Found', named], ['Plausible', plausible.filter((one) => !named.includes(one))]].map(([title, list]) => (list.length ? [h('h3', {}, title), rows(list)] : null)),
      others.length ? h('details', { open: !plausible.length }, h('summary', {}, plausible.length ? `Improbable (${others.length})` : `None is plausible; the nearest ${others.length}`), rows(others)) : null),
    none.length ? h('p', { class: 'faint' }, `Explain nothing here: ${none.join(', ')}.`) : null);
}

function reason(found, one) {
  if (isPlausible(one)) return '';
  const ties = one.family.split('/').filter((name) => name !== one.name && found.effects.includes(name));
  const names = (ties.length ? ties : found.effects).map((name) => nameOf(found, name));
  return names.length ? `stand-in for ${names.join(', ')}` : '';
}

function row(state, found, one, { error, noise }) {
  const seen = state.previews.includes(one.name);
  const bar = (value, kind) => { const node = h('div', { class: `fill ${kind}` }); node.style.width = `${Math.min(100, (100 * Math.max(value, 0)) / error)}%`; return node; };
  const floor = h('div', { class: 'noise' });
  floor.style.width = `${Math.min(100, (100 * noise) / error)}%`;
  const why = reason(found, one);
  const sure = ` ${one.probability > 0.99 ? 'over 99 %' : one.probability < 0.01 ? 'under 1 %' : percent(one.probability)} sure${one.share >= 0.01 ? `, ${percent(one.share)} of what is missed` : ''}`;
  const node = h('div', { class: `candidate${isPlausible(one) ? ' in' : ''}`, 'data-preview': seen },
    h('span', {}, one.words, h('small', {}, why ? `${sure}, ${why}` : sure)),
    h('div', { class: 'track', 'aria-hidden': 'true' }, bar(one.delta_rmse_w, 'alone'), bar(one.explains_w, 'with'), floor),
    h('span', { class: 'falls' }, watts(Math.max(one.delta_rmse_w, 0)), h('small', {}, ` ${watts(one.explains_w)}`)),
    h('small', { class: 'value' }, `${one.drive} ${quantity(one.coefficient, one.unit)} `, whisker(one.coefficient, one.interval, [Math.min(0, one.interval[0]), Math.max(0, one.interval[1])], one.unit)),
    found.effects.includes(one.name) || Math.max(one.delta_rmse_w, one.explains_w) >= NOTHING * error ? h('button', { type: 'button', disabled: Boolean(state.job), 'aria-label': `Add ${one.words}`, onclick: () => take({ kind: 'add', effects: [one.name] }) }, 'Add') : null);
  if (seen) {
    for (const event of ['mouseenter', 'focusin']) node.addEventListener(event, () => preview(one));
    for (const event of ['mouseleave', 'focusout']) node.addEventListener(event, () => preview(null));
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
  const terms = Object.entries(found.measurement);
  const rows = terms.map(([name, term]) => h('tr', {},
    h('td', {}, name.replaceAll('_', ' ')), h('td', { class: 'number' }, quantity(term.value, term.unit)),
    h('td', { class: 'number' }, watts(term.watts)), h('td', {}, term.matters ? h('strong', {}, 'yes') : 'no')));
  const head = ['error of the measurement', 'value', 'error if ignored', 'significant'].map((text, index) => h('th', { scope: 'col', class: index === 1 || index === 2 ? 'number' : '' }, text));
  const matters = terms.filter(([, term]) => term.matters).length;
  return h('details', { open: matters > 0 }, h('summary', {}, `Is the measurement sound? ${matters ? plural(matters, 'significant error') : 'Nothing significant'}`), h('div', { class: 'scroll', tabindex: 0, role: 'group', 'aria-label': 'Errors of the measurement' }, h('table', {}, h('thead', {}, h('tr', {}, head)), h('tbody', {}, rows))));
}

const BASELINES = [['mechanical_power', '|torque · speed|'], ['mechanical_power_positive', 'torque · speed where driving'], ['torque_squared', 'torque²'], ['torque_abs', '|torque|'], ['acceleration_squared', 'acceleration²']];

/** A list of baselines and models whose error is drawn as a line. */
function other() {
  const pick = h('select', { 'aria-label': 'Compare with' },
    h('optgroup', { label: 'one scaled quantity' }, BASELINES.map(([value, label]) => h('option', { value }, label))),
    h('optgroup', { label: 'networks and models' }, modelFiles().map((file) => h('option', { value: file }, shortened(file)))));
  const go = (event) => { event.preventDefault(); attempt(() => post('line', { model: pick.value })); };
  return h('form', { class: 'row', onsubmit: go }, 'Compare with', pick, h('button', { type: 'submit' }, 'Compare'));
}

/** Coefficients before and after the last step; those that left their interval trade off. */
function changes({ model, before }) {
  const rows = model.effects.flatMap((effect) => effect.coefficients.map((one) => {
    const old = ((before[effect.name] || {})[one.group] || []).find((former) => former.symbol === one.symbol);
    return old && { effect, one, old, left: Boolean(one.at_bound) || one.value < old.interval[0] || one.value > old.interval[1] };
  })).filter(Boolean);
  if (!rows.length) return null;
  const added = model.effects.filter((effect) => !before[effect.name]).map((effect) => effect.words);
  const moved = [...new Set(rows.filter((row) => row.left).map((row) => row.effect.words))];
  const head = ['coefficient', 'before', 'after', ''].map((text, index) => h('th', { scope: 'col', class: index === 1 || index === 2 ? 'number' : '' }, text));
  return h('details', { open: moved.length > 0 },
    h('summary', {}, moved.length ? `Coefficients changed: ${moved.join(', ')}` : 'Coefficients before and after: all within their intervals'),
    moved.length && added.length ? h('p', {}, `These trade off with ${added.join(', ')} in this recording: part of what they explained may have been its work, or the other way round.`) : null,
    h('div', { class: 'scroll', tabindex: 0, role: 'group', 'aria-label': 'Coefficients before and after' }, h('table', {}, h('thead', {}, h('tr', {}, head)), h('tbody', {}, rows.map(({ effect, one, old, left }) => h('tr', {},
      h('th', { scope: 'row' }, `${effect.words}, ${one.group} ${one.words}`), h('td', { class: 'number' }, quantity(old.value, one.unit)), h('td', { class: 'number' }, quantity(one.value, one.unit)),
      h('td', {}, one.at_bound ? h('span', { class: 'limit' }, 'at limit') : left ? 'changed' : '')))))));
}

export function stairs() {
  const { state } = bench;
  const { stairs: steps, view } = state;
  const lines = [['meter’s noise', view.noise_w, 'dot'], ...state.lines.map((one) => [shortened(one.name), one.rmse_w, 'dash'])].filter(([, level]) => level != null);
  const body = find('stairs-body');
  if (!find('plot-stairs')) fill(body, h('p', { id: 'stairs-words' }), h('div', { class: 'plot low', id: 'plot-stairs' }), h('div', { id: 'changes' }), other());
  fill(find('changes'), state.model && state.before ? changes(state) : null);
  const last = steps[steps.length - 1];
  const first = steps[0];
  find('stairs-words').textContent = `${steps.length > 1
    ? `From ${watts(first.rmse_w)} to ${watts(last.rmse_w)} in ${plural(steps.length - 1, 'step')}`
    : `The first model is ${watts(first.rmse_w)} off`}; the meter’s noise is ${watts(view.noise_w)}. Error on unseen data (${view.scores.held_out === 'cross-validated' ? '5-fold' : view.scores.held_out}), rms over the drives.`;
  const top = Math.max(...steps.map((one) => one.rmse_w), ...lines.map(([, level]) => level));
  draw(find('plot-stairs'), find('stairs-words').textContent, () => [[{
    type: 'bar', x: steps.map((_, index) => index), y: steps.map((one) => one.rmse_w), text: steps.map((one) => watts(one.rmse_w)), textposition: 'outside', cliponaxis: false,
    marker: { color: steps.map((_, index) => color(index ? 'better' : 'base')) }, hovertemplate: '%{y:.3~g} W<extra></extra>',
  }], {
    bargap: 0.5, margin: { l: 58, r: 12, t: 16, b: 64 },
    xaxis: { range: [-0.6, steps.length + 0.1], tickvals: steps.map((_, index) => index), ticktext: steps.map((one, index) => (index ? one.label : 'first model').replace(/(.{18}\S*) /g, '$1<br>')), fixedrange: true },
    yaxis: { title: { text: 'error on unseen data in W' }, range: [0, 1.2 * top], fixedrange: true },
    shapes: lines.map(([, level, dash]) => ({ type: 'line', xref: 'paper', x0: 0, x1: 1, y0: level, y1: level, line: { color: color('faint'), dash } })),
    annotations: lines.map(([name, level]) => ({ xref: 'paper', x: 1, xanchor: 'right', y: level, yanchor: 'bottom', showarrow: false, text: `${name} ${watts(level)}`, font: { color: color('text') } })),
  }]);
}
