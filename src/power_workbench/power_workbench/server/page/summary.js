// The headline: where the watts go or what the model misses, and the next step as one button.

import { attempt, bench, command, fill, find, h, percent, post, quantity, take, watts } from './dom.js';
import { FIRST, wordsOf } from './model.js';

const TONES = { named: 'named', ambiguous: 'ambiguous', none_of_the_above: 'ambiguous', no_evidence: 'no_evidence' };

const capital = (text) => text[0].toUpperCase() + text.slice(1);

/** Mean metered W of a score. */
const mean = (score) => (score.energy_j * SAMPLES) / score.samples;
const SAMPLES = 50; // of a second

/** What the model explains of all drives and of the worst, and what it misses. */
function explained({ scores, meters }) {
  const known = meters.map((name) => ({ name, ...scores.drives[name] })).filter((one) => one.rmse_w != null);
  if (!known.length) return 'The model is judged on nothing of these recordings.';
  const square = (one) => one.rmse_w ** 2;
  const sum = (of) => known.reduce((total, one) => total + of(one), 0);
  const worst = known.reduce((a, b) => (b.rmse_w > a.rmse_w ? b : a));
  const told = (one) => `${percent(Math.max(one.r2, 0))} of ${one.name}; it misses ${watts(one.rmse_w)} rms of ${watts(mean(one))}`;
  if (known.length === 1) return `The model explains ${told(worst)}.`;
  const share = 1 - sum(square) / sum((one) => square(one) / Math.max(1 - one.r2, 1e-9));
  return `The model explains ${percent(Math.max(share, 0))} of the power of ${known.length} drives; it misses ${watts(Math.sqrt(sum(square) / known.length))} rms of a mean of ${watts(sum(mean) / known.length)} a drive, most in ${worst.name} (${watts(worst.rmse_w)} of ${watts(mean(worst))}).`;
}

/** Error and share explained of one score. */
export const judged = (one) => `misses ${watts(one.rmse_w)} rms of a mean of ${watts(mean(one))} (${percent(one.rmse_w / Math.abs(mean(one)))}), explains ${percent(one.r2)} (R²)`;

function step(state) {
  const { diagnosis: found, learned } = state;
  const go = (id) => () => { const node = find(id).querySelector('details'); if (node) node.open = true; find(id).scrollIntoView(); };
  const report = ['Write the report', () => attempt(() => post('report'))];
  if (!state.model && state.budget.effects) return ['Fit the effects of this budget', () => take({ kind: 'fit', effects: state.budget.effects }), 'Makes this model the page’s own; the page then shows where it fails and finds what it misses. Or fit another under “Model”.'];
  if (!state.model) return ['Fit a first model', () => take({ kind: 'fit', effects: FIRST }), `Of ${FIRST.map(wordsOf).join(', ')}; or choose effects under “Model”. The page then finds what it misses.`];
  if (!found && learned) return ['See what was discovered', go('missing'), ''];
  if (!found) return ['Find what is missing', () => attempt(() => post('diagnose')), 'Every effect of the catalogue is tried on data that the fit did not see.'];
  const active = new Set(state.model.effects.map((one) => one.name));
  const missing = found.effects.filter((name) => !active.has(name));
  const squares = (key) => Object.values(found.drives).reduce((sum, one) => sum + (one[key] || 0) ** 2, 0);
  if (found.verdict === 'named' && missing.length && squares('rmse_after_w') >= squares('rmse_w')) return ['See what to record next', go('next'), 'The error on unseen data does not fall with it; the motion proposed there would show it.'];
  if (found.verdict === 'named' && missing.length) return [missing.length > 1 ? `Add all ${missing.length}` : `Add ${wordsOf(missing[0])}`, () => take({ kind: 'add', effects: missing }), 'All coefficients are fitted anew.'];
  if (found.verdict === 'ambiguous') return ['See what to record next', go('next'), 'This recording cannot tell these effects apart; the motion proposed there can.'];
  if (found.verdict === 'none_of_the_above' && !learned) return ['Discover what no catalogue has', () => attempt(() => post('discover')), 'It learns the shape of what is missing, and writes it down as an effect of your own.'];
  if (learned && learned.file) return ['See what was discovered', go('missing'), ''];
  return [...report, 'Or record the motion that is proposed below, which would show more.'];
}

/** The error of the measurement that costs most, as a sentence, where it costs enough. */
function measured(found, { scores }) {
  const [worst] = Object.entries(found.measurement).filter(([, term]) => term.matters).sort(([, a], [, b]) => b.watts - a.watts);
  if (!worst) return null;
  const [name, term] = worst;
  if (term.watts < 0.05 * Math.max(...Object.values(scores.drives).map((one) => one.rmse_w))) return null;
  return h('p', { class: 'warning' }, `The measurement may be off: ${SAYS[name] ? SAYS[name](term) : `${name.replaceAll('_', ' ')} ${quantity(term.value, term.unit)}`}${term.drive ? ` in ${term.drive}` : ''}; ignored, this puts ${watts(term.watts)} on the error.`);
}

const SAYS = {
  power_gain: (term) => `the power meter reads ${percent(Math.abs(term.value))} ${term.value > 0 ? 'high' : 'low'}`,
  torque_scale: (term) => `the torque reads ${percent(Math.abs(term.value))} ${term.value > 0 ? 'high' : 'low'}`,
  time_offset: (term) => `power and motion are ${quantity(Math.abs(term.value), 's')} apart`,
};

export function update() {
  const { state } = bench;
  const { view, budget, diagnosis: found } = state;
  const head = (text) => h('h2', { id: 'headline' }, text);
  if (!state.opened.length) {
    fill(find('summary'), head('Where do the watts go?'), h('p', { class: 'lead' }, 'Open a recording: this page shows where its power goes and what would save most, then what a model of it misses.'));
    return;
  }
  const parts = [];
  if (view && view.scores) {
    const verdict = found && state.model;
    if (verdict) parts.push(h('p', { class: `kind ${TONES[found.verdict]}` }, found.kind));
    parts.push(head(explained(view)));
    if (verdict) parts.push(h('p', { class: 'verdict', id: 'verdict' }, found.sentence.replaceAll('`', '')), measured(found, view));
  } else parts.push(head(budget.headline ? `${capital(budget.headline)}.`.replaceAll(' %', '\u00a0%') : view && view.share >= 1 ? 'The recording is open.' : 'Reading the recordings…'));
  if (view && (view.scores || !state.model) && view.share >= 1) {
    const [label, work, why] = step(state);
    parts.push(h('div', { class: 'row' }, h('button', { type: 'button', class: 'main', id: 'next-step', disabled: Boolean(state.job), onclick: work }, label), h('span', { class: 'faint' }, why)));
    if (label === 'Find what is missing') parts.push(h('details', {}, h('summary', {}, 'The same as a command'), command(state.commands.diagnose)));
  }
  fill(find('summary'), parts);
}
