// The model: effects as chips, a first fit, load, history.

import { attempt, bench, command, fill, find, h, number, post, take } from './dom.js';

const FIRST = ['shaft', 'copper_loss', 'idle'];
const OTHERS = ['viscous_friction', 'coulomb_friction', 'rotor_inertia'];

export function update() {
  const { state } = bench;
  const parts = [];
  for (const file of state.effect_files.filter((one) => !one.allowed)) parts.push(permission(file.file));
  if (!state.opened.length) parts.push(h('p', {}, 'Open a recording first.'));
  else if (state.model) parts.push(present(state));
  else parts.push(h('p', {}, 'There is no model yet. Fit one: tick the effects that you are sure of.'), firstFit(true));
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
  const chips = model.effects.map((effect) => h('li', { class: 'chip' },
    h('strong', {}, effect.words),
    h('span', { class: 'faint' }, effect.formula),
    effect.fixed != null ? h('span', { class: 'number' }, `fixed at ${number(effect.fixed)}`) : null,
    coefficients(effect),
    model.effects.length > 1 ? h('button', { type: 'button', 'aria-label': `Remove ${effect.words}`, onclick: () => take({ kind: 'remove', effects: [effect.name] }) }, 'Remove') : null));
  const active = new Set(model.effects.map((effect) => effect.name));
  const free = bench.known.catalogue.filter((effect) => !active.has(effect.name));
  const pick = h('select', { 'aria-label': 'Effect to add' }, free.map((effect) => h('option', { value: effect.name }, effect.words)));
  return h('div', {},
    h('p', {}, h('strong', {}, model.name), model.base ? ` on ${model.base}` : '', state.view && state.view.scores ? ` · held out: ${state.view.scores.held_out}` : ''),
    h('ul', { class: 'chips' }, chips),
    h('div', { class: 'row' }, pick, h('button', { type: 'button', onclick: () => take({ kind: 'add', effects: [pick.value] }) }, 'Add this effect')),
    h('details', {}, h('summary', {}, 'Another model: fit anew, load a file'), firstFit(false), loading()));
}

function coefficients(effect) {
  const rows = effect.coefficients.slice(0, 4).map((one) => [
    h('span', { class: 'number' }, `${one.group}: ${one.symbol} = ${number(one.value)} ${one.unit === '1' ? '' : one.unit} (${number(one.interval[0])} … ${number(one.interval[1])})`),
    one.at_bound ? h('span', { class: 'bound' }, `at its ${one.at_bound} bound: the recording does not give this value`) : null]);
  if (effect.coefficients.length > 4) rows.push([h('span', { class: 'number' }, `and ${effect.coefficients.length - 4} more`)]);
  return rows.flat();
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
    h('fieldset', { class: 'choices' }, h('legend', {}, 'Effects'), sorted.map(box)),
    h('details', {}, h('summary', {}, 'More'), h('div', { class: 'row' },
      h('label', {}, 'coefficients shared by ', h('select', {}, h('option', { value: '' }, 'drives of a type'), h('option', { value: 'drive' }, 'no one: each drive its own'))),
      h('label', {}, 'on a network ', h('input', { type: 'text', name: 'base', placeholder: 'ppn:RUN' })))),
    h('div', { class: 'row' }, h('button', { type: 'submit', class: first ? 'main' : '' }, 'Fit'), first ? null : ''),
    first ? loading() : null);
}

function loading() {
  const files = [...new Set(bench.known.models)].filter((file) => !/\/(card|metadata|session)\.yaml$/.test(file));
  if (!files.length) return null;
  const pick = h('select', { 'aria-label': 'Model file' }, files.map((file) => h('option', { value: file }, file.split('/').slice(-2).join('/'))));
  return h('div', { class: 'row' }, 'or load a file', pick, h('button', { type: 'button', onclick: () => take({ kind: 'load', file: pick.value }) }, 'Load'));
}

function history(state) {
  const items = state.steps.map((step, index) => h('li', { class: index < state.at ? '' : 'undone' },
    h('button', { type: 'button', class: 'link', 'aria-current': index + 1 === state.at ? 'step' : null, onclick: () => attempt(() => post('go', { at: index + 1 })) }, step.label),
    step.rmse_w != null ? h('span', { class: 'faint' }, ` ${step.rmse_w.toPrecision(3)} W`) : null,
    command(step.command)));
  return h('details', { id: 'history' }, h('summary', {}, `History: ${state.at} of ${state.steps.length} steps, with their commands`), h('ol', { class: 'history' }, items));
}
