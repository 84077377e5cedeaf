// The page: one session, asked for news, drawn part by part.

import { ask, attempt, bench, find, fill, h, post, tell } from './dom.js';
import * as logs from './logs.js';
import * as live from './live.js';
import * as keep from './keep.js';
import * as missing from './missing.js';
import * as model from './model.js';
import * as next from './next.js';
import * as recordings from './recordings.js';
import * as traces from './traces.js';
import * as where from './where.js';

const STEPS = [
  ['recordings', 'Recordings', (s) => s.opened.length > 0],
  ['model', 'Model', (s) => Boolean(s.model)],
  ['where', 'Where it fails', (s) => Boolean(s.model && (bench.choice || s.diagnosis || s.stairs.length > 1))],
  ['missing', 'What is missing', (s) => Boolean(s.diagnosis)],
  ['stairs', 'The error falls', (s) => s.stairs.length > 1],
  ['keep', 'Keep', () => false],
];

function hint(s) {
  if (s.job) return 'Work is under way; you can look around meanwhile.';
  if (!s.opened.length) return 'First, open a recording below.';
  if (!s.model) return 'Next, fit a first model of the effects that you are sure of.';
  if (!s.diagnosis && s.stairs.length < 2) return 'Next, look where the model fails, then press “Find what is missing”.';
  if (!s.diagnosis) return 'The error after the last step is in “The error falls”. Press “Find what is missing” again to see whether anything is left.';
  const named = s.diagnosis.effects.length;
  if (s.diagnosis.verdict === 'named' && named) return 'The verdict names an effect. Add it, and watch the error fall.';
  if (s.diagnosis.verdict === 'no_evidence') return 'Nothing is missing that this recording could show. Keep the model, or record what is proposed.';
  if (s.diagnosis.verdict === 'none_of_the_above' && s.learned) return s.learned.file ? 'discover has written an effect of your own. Look at its shape, run the file, and add it.' : 'Neither the catalogue nor discover explains the rest: keep the model, or record what is proposed.';
  if (s.diagnosis.verdict === 'none_of_the_above') return 'No effect of the catalogue explains what is left. Press “Discover what no catalogue has” under the candidates.';
  return 'The verdict is not certain. Compare the candidates, or record what is proposed.';
}

/** Parts of the state that a section depends on, so that the rest of the page stays as it is. */
const PARTS = [
  [(s) => [s.opened, s.recordings], () => recordings.update()],
  [(s) => [s.opened.length, s.model, s.steps, s.at, s.effect_files], () => model.update()],
  [(s) => [s.log, s.made, Boolean(s.job)], () => logs.update()],
  [(s) => [s.model && s.model.name, s.opened.length], () => live.update()],
  [(s) => [s.view, s.at, s.opened], (s) => {
    for (const id of ['traces', 'where']) find(id).hidden = !s.view || (id === 'where' && !s.view.scores);
    bench.selection = bench.choice = bench.preview = null;
    if (s.view) traces.update();
    if (s.view && s.view.scores) where.update();
  }],
  [(s) => [s.diagnosis, s.model, s.commands, s.learned, s.effect_files, Boolean(s.job)], (s) => {
    find('missing').hidden = !s.model;
    if (s.model) missing.update();
  }],
  [(s) => [s.diagnosis, s.made, s.commands, Boolean(s.job)], (s) => {
    find('next').hidden = !s.diagnosis || !s.model;
    if (s.diagnosis && s.model) next.update();
  }],
  [(s) => [s.stairs, s.view && s.view.noise_w, s.lines], (s) => {
    find('stairs').hidden = !s.stairs.length || !s.view;
    if (s.stairs.length && s.view) missing.stairs();
  }],
  [(s) => [s.steps, s.at, s.model_file, s.files, Boolean(s.job)], (s) => {
    find('keep').hidden = !s.model;
    if (s.model) keep.update();
  }],
];
const before = PARTS.map(() => '');

/** Where the button that was pressed is drawn anew, its section's heading takes the focus. */
function keepingFocus(work) {
  const held = document.activeElement;
  const section = held && held.closest('main section');
  work();
  if (!section || held.isConnected || section.hidden) return;
  const heading = section.querySelector('h2');
  heading.tabIndex = -1;
  heading.focus({ preventScroll: true });
}

function render(s) {
  bench.state = s;
  find('undo').disabled = !s.at || Boolean(s.job);
  find('redo').disabled = s.at >= s.steps.length || Boolean(s.job);
  find('hint').textContent = hint(s);
  find('job').hidden = !s.job;
  if (s.job) { bench.since = performance.now() - 1000 * s.job.seconds; ticking(); }
  if (s.error) tell(s.error === 'cancelled' ? 'Cancelled.' : s.error);
  PARTS.forEach(([of, draw], index) => {
    const now = JSON.stringify(of(s));
    if (now === before[index]) return;
    before[index] = now;
    keepingFocus(() => draw(s));
  });
  const current = STEPS.find(([, , done]) => !done(s));
  fill(find('steps'), h('ol', {}, STEPS.map(([id, label, done]) => h('li', { class: done(s) ? 'done' : current && current[0] === id ? 'now' : '' }, h('a', { href: `#${id}` }, label)))));
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
  find('recordings-body').after(h('details', { id: 'earlier' }, h('summary', {}, `Earlier sessions (${others.length})`),
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

find('undo').addEventListener('click', () => attempt(() => post('go', { at: bench.state.at - 1 })));
find('redo').addEventListener('click', () => attempt(() => post('go', { at: bench.state.at + 1 })));
find('cancel').addEventListener('click', () => attempt(() => post('cancel')));
document.addEventListener('keydown', (event) => {
  if (!(event.ctrlKey || event.metaKey) || /^(input|textarea|select)$/i.test(event.target.tagName)) return;
  if (event.key === 'z' && !find('undo').disabled) { event.preventDefault(); find('undo').click(); }
  if (event.key === 'y' && !find('redo').disabled) { event.preventDefault(); find('redo').click(); }
});
attempt(begin);
