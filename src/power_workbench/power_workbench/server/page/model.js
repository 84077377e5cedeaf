// The model: its effects with their coefficients, a first fit, load, history.

import { attempt, bench, command, fill, find, h, post, quantity, take, watts, whisker } from './dom.js';

export const FIRST = ['shaft', 'copper_loss', 'idle'];
const OTHERS = ['viscous_friction', 'coulomb_friction', 'rotor_inertia'];
const SHOWN = 4; // coefficients of an effect
const SYMBOLS = {
  motor_torque: ['τ', 'm'], torque: ['τ'], acceleration: ['ω̇'], 'dw/dt': ['ω̇'], w: ['ω'], eta: ['η'], delta: ['δ'], q: ['q'], dT: ['ΔT'],
  P0: ['P', '0'], c0: ['c', '0'], I0: ['I', '0'], Tc: ['T', 'c'], Ts: ['T', 's'], Rl: ['R', 'l'], ks: ['k', 's'],
};

/** A file's address as its last two parts. */
export const shortened = (file) => file.split('/').slice(-2).join('/');
/** Files that may be models. */
export const modelFiles = () => [...new Set(bench.known.models)].filter((file) => !/\/(card|metadata|session|notes)\.yaml$/.test(file));
export const wordsOf = (name) => (bench.known.catalogue.find((one) => one.name === name) || { words: name.replaceAll('_', ' ') }).words;

/** A formula with its symbols in italics and subscripts. */
function typeset(formula) {
  const parts = formula.split(/(dw\/dt|[A-Za-z]\w*)/).map((part) => {
    const [base, below] = SYMBOLS[part] || (/^[A-Za-z]$/.test(part) ? [part] : []);
    return base ? h('i', {}, base, below ? h('sub', {}, below) : null) : part;
  });
  return h('span', { class: 'formula' }, parts);
}

export function update() {
  const { state } = bench;
  find('model').hidden = !state.opened.length;
  const parts = state.effect_files.filter((one) => !one.allowed).map((one) => permission(one.file));
  if (state.model) parts.push(present(state));
  else if (state.opened.length) parts.push(firstFit(true));
  if (state.steps.length) parts.push(history(state));
  fill(find('model-body'), parts);
}

function permission(file) {
  return h('div', { class: 'selection' },
    h('p', {}, `This session uses effects of ${file}. The file is a program: allow it only if you trust it.`),
    h('button', { type: 'button', onclick: () => attempt(() => post('allow', { file })) }, 'Run this file'));
}

function present(state) {
  const { model } = state;
  const sides = (state.view && state.view.scores && state.view.scores.both_sides) || [];
  const limits = model.effects.some((effect) => effect.coefficients.some((one) => one.at_bound));
  const chips = model.effects.map((effect) => h('li', { class: 'chip' },
    h('strong', {}, effect.words), typeset(effect.formula.split(/[;,] (?=with|motor_torque|the fit|dT |relax|coefficient)/)[0]),
    coefficients(effect),
    model.effects.length > 1 ? h('button', { type: 'button', 'aria-label': `Remove ${effect.words}`, onclick: () => take({ kind: 'remove', effects: [effect.name] }) }, 'Remove') : null));
  const active = new Set(model.effects.map((effect) => effect.name));
  const pick = h('select', { 'aria-label': 'Effect to add' }, bench.known.catalogue.filter((effect) => !active.has(effect.name)).map((effect) => h('option', { value: effect.name }, effect.words)));
  return h('div', {},
    h('p', { class: 'faint' }, `${model.name}${model.base ? ` on ${model.base}` : ''}. Whiskers are 95 % intervals.`,
      limits ? [' ', h('span', { class: 'limit' }, 'at limit'), ': the recording does not give this value.'] : ''),
    h('ul', { class: 'chips' }, chips),
    sides.length ? [h('h3', {}, 'Both sides of the gear'), h('ul', {}, sides.map((line) => h('li', {}, line)))] : null,
    h('div', { class: 'row' }, pick, h('button', { type: 'button', onclick: () => take({ kind: 'add', effects: [pick.value] }) }, 'Add this effect')),
    h('details', {}, h('summary', {}, 'Another model: fit anew, load a file'), firstFit(false), loading()));
}

function coefficients(effect) {
  const all = effect.coefficients;
  if (!all.length) return null;
  const top = (symbol) => Math.max(0, ...all.filter((one) => one.symbol === symbol).map((one) => one.interval[1]));
  const low = (symbol) => Math.min(0, ...all.filter((one) => one.symbol === symbol).map((one) => one.interval[0]));
  const row = (one) => h('tr', {}, h('th', { scope: 'row' }, `${one.group} ${one.words}`), h('td', { class: 'number' }, one.at_bound ? h('span', { class: 'limit' }, 'at limit') : quantity(one.value, one.unit)), h('td', {}, whisker(one.value, one.interval, [low(one.symbol), top(one.symbol)], one.unit)));
  const rows = all.map(row);
  return [h('table', {}, h('tbody', {}, rows.slice(0, SHOWN))), rows.length > SHOWN ? h('details', {}, h('summary', {}, `${rows.length - SHOWN} more`), h('table', {}, h('tbody', {}, rows.slice(SHOWN)))) : null];
}

function firstFit(first) {
  const fit = (event) => {
    event.preventDefault();
    const effects = [...event.target.querySelectorAll('input:checked')].map((box) => box.value);
    const base = event.target.querySelector('input[name="base"]').value.trim();
    take({ kind: 'fit', effects, base, per: event.target.querySelector('select').value });
  };
  const order = [...FIRST, ...OTHERS];
  const sorted = [...bench.known.catalogue].sort((a, b) => (order.indexOf(a.name) + 99) % 99 - (order.indexOf(b.name) + 99) % 99);
  const box = (effect) => h('label', { class: 'choice', title: effect.physics }, h('input', { type: 'checkbox', value: effect.name, checked: FIRST.includes(effect.name) }), h('span', {}, effect.words));
  return h('form', { onsubmit: fit },
    first ? h('p', {}, 'Tick the effects that you are sure of; the page finds what is missing.') : null,
    h('fieldset', { class: 'choices' }, h('legend', {}, 'Effects'), sorted.map(box)),
    h('details', {}, h('summary', {}, 'More'), h('div', { class: 'row' },
      h('label', {}, 'coefficients shared by ', h('select', {}, h('option', { value: '' }, 'drives of a type'), h('option', { value: 'drive' }, 'no one: each drive its own'))),
      h('label', {}, 'on a network ', h('input', { type: 'text', name: 'base', placeholder: 'ppn:RUN' })))),
    h('div', { class: 'row' }, h('button', { type: 'submit' }, 'Fit')),
    first ? loading() : null);
}

function loading() {
  const files = modelFiles();
  if (!files.length) return null;
  const pick = h('select', { 'aria-label': 'Model file' }, files.map((file) => h('option', { value: file }, shortened(file))));
  return h('div', { class: 'row' }, 'or load a file', pick, h('button', { type: 'button', onclick: () => take({ kind: 'load', file: pick.value }) }, 'Load'));
}

function history(state) {
  const items = state.steps.map((step, index) => h('li', { class: index < state.at ? '' : 'undone' },
    h('button', { type: 'button', class: 'link', 'aria-current': index + 1 === state.at ? 'step' : null, onclick: () => attempt(() => post('go', { at: index + 1 })) }, step.label),
    step.rmse_w != null ? h('span', { class: 'faint' }, ` ${watts(step.rmse_w)}`) : null,
    command(step.command)));
  return h('details', { id: 'history' }, h('summary', {}, `History: ${state.at} of ${state.steps.length} steps, with their commands`), h('ol', { class: 'history' }, items));
}
