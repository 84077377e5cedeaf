// The page: one session, asked for news, drawn part by part.

import { ask, attempt, bench, find, fill, h, plural, post, refused, tell } from './dom.js';
import * as budget from './budget.js';
import * as logs from './logs.js';
import * as live from './live.js';
import * as keep from './keep.js';
import * as missing from './missing.js';
import * as model from './model.js';
import * as next from './next.js';
import * as recordings from './recordings.js';
import * as summary from './summary.js';
import * as traces from './traces.js';
import * as where from './where.js';

const STEPS = [
  ['budget', 'Budget'], ['recordings', 'Recordings'], ['model', 'Model'], ['traces', 'Measured against model'], ['where', 'Where it fails'],
  ['missing', 'What is missing'], ['stairs', 'Error'], ['next', 'Record next'], ['keep', 'Keep'],
];

/** Steps that collapse once they are done: whether they are, and what their line says then. */
const COLLAPSE = [
  ['recordings', (s) => s.opened.length > 0 && Boolean(s.view), (s) => s.recordings.map((one) => `${one.name}, ${one.seconds.toFixed(0)} s, ${plural(one.drives.filter((drive) => drive.updates_hz != null).length || one.drives.length, 'drive')}${one.findings.length + one.problems.length ? `, ${plural(one.findings.length + one.problems.length, 'remark')}` : ''}`).join(' · ')],
  ['model', (s) => Boolean(s.model), (s) => (s.model ? s.model.effects.map((one) => one.words).join(', ') || s.model.name : '')],
  ['next', (s) => !(s.diagnosis && s.diagnosis.verdict === 'ambiguous'), (s) => (s.diagnosis ? `${Math.round(s.diagnosis.next_recording.seconds)} s ${s.diagnosis.next_recording.reason.split(';')[0]}` : '')],
  ['keep', () => true, (s) => `${plural(s.files.length, 'file')}: session, models, reports, commands`],
];
const collapsed = {};

function collapse(s) {
  for (const [id, done, digest] of COLLAPSE) {
    const [node, now] = [find(id).querySelector('details'), done(s)];
    node.querySelector('.digest').textContent = now ? digest(s) : '';
    if (collapsed[id] !== now) node.open = !now;
    collapsed[id] = now;
  }
}

/** Parts of the state that a section depends on, so that the rest of the page stays as it is. */
const PARTS = [
  [(s) => [s.opened, s.view, s.model, s.budget, s.diagnosis, s.learned, s.commands, Boolean(s.job)], () => summary.update()],
  [(s) => [s.budget, s.at, s.opened, Boolean(s.view)], () => budget.update()],
  [(s) => [s.opened, s.recordings], () => recordings.update()],
  [(s) => [s.opened.length, s.model, s.steps, s.at, s.effect_files, s.view && s.view.scores], () => model.update()],
  [(s) => [s.log, s.made, Boolean(s.job)], () => logs.update()],
  [(s) => [s.model && s.model.name, s.opened.length], () => live.update()],
  [(s) => [s.view, s.at, s.opened], (s) => {
    for (const id of ['traces', 'where']) find(id).hidden = !s.view || (id === 'where' && !s.view.scores);
    const columns = s.view && s.view.scores ? 'two' : '';
    const turned = find('loop').className !== columns;
    find('loop').className = columns;
    bench.selection = bench.choice = bench.preview = null;
    if (s.view) traces.update();
    if (s.view && s.view.scores) where.update();
    if (turned) window.dispatchEvent(new Event('resize'));
  }],
  [(s) => [s.view && [s.view.hidden, s.view.share], s.steps, s.at, Boolean(s.job)], (s) => { if (s.view) traces.leftOut(); }],
  [(s) => [s.diagnosis, s.model, s.commands, s.learned, s.effect_files, Boolean(s.job)], () => missing.update()],
  [(s) => [s.diagnosis, s.made, s.commands, Boolean(s.job)], (s) => {
    find('next').hidden = !s.diagnosis || !s.model;
    if (s.diagnosis && s.model) next.update();
  }],
  [(s) => [s.stairs, s.view && [s.view.noise_w, s.view.scores], s.lines, s.model, s.before], (s) => {
    find('stairs').hidden = !s.stairs.length || !s.view || !s.view.scores;
    if (!find('stairs').hidden) missing.stairs();
  }],
  [(s) => [s.steps, s.at, s.model_file, s.files, Boolean(s.job)], (s) => {
    find('keep').hidden = !s.model;
    if (s.model) keep.update();
  }],
  [(s) => [s.opened, s.view && s.view.seconds, s.model, s.diagnosis, s.recordings, s.files], collapse],
];
const before = PARTS.map(() => '');

/** Where the button that was pressed is drawn anew, its section's heading takes the focus. */
function keepingFocus(work) {
  const held = document.activeElement;
  const section = held && held.closest('main section');
  work();
  if (!section || held.isConnected || section.hidden) return;
  const heading = section.querySelector('h2');
  if (!heading) return;
  heading.tabIndex = -1;
  heading.focus({ preventScroll: true });
}

function render(s) {
  bench.state = s;
  find('undo').disabled = !s.at || Boolean(s.job);
  find('redo').disabled = s.at >= s.steps.length || Boolean(s.job);
  find('job').hidden = !s.job;
  if (s.job) { bench.since = performance.now() - 1000 * s.job.seconds; ticking(); }
  if (s.error) tell(s.error === 'cancelled' ? 'Cancelled.' : s.error, ...refused(s.error));
  PARTS.forEach(([of, draw], index) => {
    const now = JSON.stringify(of(s));
    if (now === before[index]) return;
    before[index] = now;
    keepingFocus(() => draw(s));
  });
  const shown = STEPS.filter(([id]) => !find(id).hidden);
  const links = shown.map(([id]) => id).join();
  if (find('steps').dataset.links !== links) fill(find('steps'), h('ol', {}, shown.map(([id, label]) => h('li', {}, h('a', { href: `#${id}` }, label)))));
  find('steps').dataset.links = links;
  document.body.dataset.revision = s.revision;
}

function ticking() {
  const { job } = bench.state;
  if (!job) return;
  find('job-text').textContent = `${job.name}: ${job.stage}, ${((performance.now() - bench.since) / 1000).toFixed(0)} s`;
  clearTimeout(bench.tick);
  bench.tick = setTimeout(ticking, 1000);
}

async function follow() {
  let after = -1;
  for (;;) {
    try {
      const state = await ask(`/api/sessions/${bench.session}/state?after=${after}`);
      if (bench.lost) { bench.lost = false; tell(''); }
      if (state.revision !== after) render(state);
      after = state.revision;
    } catch (error) {
      bench.lost = true;
      if (error.status === 404) { sessionStorage.clear(); location.reload(); return; }
      tell(error.status ? error.message : 'The workbench does not answer. Was it ended? The steps are saved; start it again and open its new address.');
      after = -1;
      await new Promise((done) => { setTimeout(done, 3000); });
    }
  }
}

async function earlier() {
  const { sessions } = await ask('/api/sessions');
  const others = sessions.filter((one) => one.name !== bench.session).slice(0, 8);
  if (!others.length) return;
  const go = (name) => { sessionStorage.setItem('session', name); location.reload(); };
  find('recordings').append(h('details', { id: 'earlier' }, h('summary', {}, `Earlier sessions (${others.length})`),
    h('ul', { class: 'plain' }, others.map((one) => h('li', {}, h('button', { type: 'button', class: 'link', onclick: () => go(one.name) }, `${one.name}: ${one.recordings.join(', ')}, ${one.steps} steps${one.effects.length ? `, added ${one.effects.join(', ')}` : ''}`))))));
}

async function begin() {
  bench.session = sessionStorage.getItem('session');
  if (bench.session) {
    const known = await ask(`/api/sessions/${bench.session}/state`).catch(() => null);
    if (!known) bench.session = null;
  }
  if (!bench.session) bench.session = (await ask('/api/sessions', {})).session;
  sessionStorage.setItem('session', bench.session);
  bench.known = await ask('/api/known');
  live.start();
  traces.start(where.markSpan, where.driveChanged);
  follow();
  await earlier();
}

/** Live is a mode of its own: the recordings and all that belongs to them step back. */
function mode(live) {
  find('live').hidden = !live;
  find('bench').hidden = find('steps').hidden = live;
  find('mode').textContent = live ? 'Recordings' : 'Live';
  find('mode').setAttribute('aria-pressed', String(live));
  window.dispatchEvent(new Event('resize'));
}

find('mode').addEventListener('click', () => mode(find('live').hidden));
document.addEventListener('toggle', (event) => { if (event.target.open && event.target.querySelector('.plot')) window.dispatchEvent(new Event('resize')); }, true);
find('undo').addEventListener('click', () => attempt(() => post('go', { at: bench.state.at - 1 })));
find('redo').addEventListener('click', () => attempt(() => post('go', { at: bench.state.at + 1 })));
find('cancel').addEventListener('click', () => attempt(() => post('cancel')));
document.addEventListener('keydown', (event) => {
  if (!(event.ctrlKey || event.metaKey) || /^(input|textarea|select)$/i.test(event.target.tagName)) return;
  if (event.key === 'z' && !find('undo').disabled) { event.preventDefault(); find('undo').click(); }
  if (event.key === 'y' && !find('redo').disabled) { event.preventDefault(); find('redo').click(); }
});
attempt(begin);
