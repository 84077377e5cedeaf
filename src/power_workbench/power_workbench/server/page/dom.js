// Elements, questions to the server, and what all parts of the page share.

export const bench = {
  session: null, state: null, known: null, drive: null, chosen: false, window: null, x: 'velocity', y: 'torque',
  choice: null, selection: null, preview: null,
};

export const find = (id) => document.getElementById(id);

/** Make an element: attributes, `on…` listeners, `class`, and children. */
export function h(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith('on')) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, '');
    else if (value !== false && value != null) node.setAttribute(name, value);
  }
  for (const child of children.flat(Infinity)) if (child != null) node.append(child);
  return node;
}

export function fill(node, ...children) {
  node.replaceChildren(...children.flat(Infinity).filter((child) => child != null));
}

const root = () => `/api/sessions/${bench.session}`;

async function answered(response) {
  if (response.ok) return response;
  let text = `The server answered ${response.status}.`;
  try { text = (await response.json()).error || text; } catch { /* keep the number */ }
  const error = new Error(text);
  error.status = response.status;
  throw error;
}

export async function get(path, query = {}) {
  const search = new URLSearchParams(query);
  return (await answered(await fetch(`${root()}/${path}?${search}`))).json();
}

/** Float32 arrays by name, and what else the header says. */
async function arrays(response) {
  const data = await (await answered(response)).arrayBuffer();
  const length = new DataView(data).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const out = { ...header };
  let place = 4 + length;
  for (const [name, count] of header.arrays) {
    out[name] = new Float32Array(data, place, count);
    place += 4 * count;
  }
  return out;
}

export const getArrays = async (path, query) => arrays(await fetch(`${root()}/${path}?${new URLSearchParams(query)}`));

const posted = (content) => ({ method: 'POST', headers: { 'Content-Type': 'application/json' }, body: JSON.stringify(content) });

export const postArrays = async (path, content) => arrays(await fetch(`${root()}/${path}`, posted(content)));

export async function ask(address, content) {
  return (await answered(await fetch(address, content === undefined ? {} : posted(content)))).json();
}

/** Hand a file over to the session's folder; the answer says where it lies. */
export const upload = async (file) => (await answered(await fetch(`${root()}/upload?${new URLSearchParams({ name: file.name })}`, { method: 'POST', headers: { 'Content-Type': 'application/octet-stream' }, body: file }))).json();

export const post = (path, content = {}) => ask(`${root()}/${path}`, content);

/** Say what is wrong, with a button for what would mend it. */
export function tell(text, ...mend) {
  const node = find('error');
  fill(node, text || '', mend.length ? ' ' : '', mend);
  node.hidden = !text;
}

/** Do something for the user; what goes wrong is said. */
export async function attempt(work) {
  try {
    tell('');
    return await work();
  } catch (error) {
    if (error.name !== 'AbortError') tell(error.message);
    return undefined;
  }
}

export const take = (step) => {
  bench.taken = step;
  return attempt(() => post('step', step));
};

/** Buttons that open refused recordings all the same, as the error's options do. */
export function refused(error) {
  const step = bench.taken;
  if (!step || step.kind !== 'open') return [];
  const offers = [[/--(slow|slow-meter)\b/, 'slow', 'Open with the slow meter'], [/--(anyway|ignore-unit-conflicts)\b/, 'anyway', 'Open as it is']];
  return offers.filter(([option, name]) => option.test(error) && !step[name]).map(([, name, label]) => h('button', { type: 'button', onclick: () => take({ ...step, [name]: true }) }, label));
}

/** Three digits; very large and small ones with a power of ten. */
export function number(value) {
  if (value == null) return '–';
  if (typeof value === 'string') return value;
  const short = Number(Number(value).toPrecision(3));
  if (short === 0 || (Math.abs(short) >= 1e-3 && Math.abs(short) < 1e5)) return short.toString().replace('-', '−');
  const [digits, power] = short.toExponential().split('e');
  return `${digits}·10${[...power.replace('+', '')].map((one) => '⁰¹²³⁴⁵⁶⁷⁸⁹⁻'['0123456789-'.indexOf(one)]).join('')}`.replace('-', '−');
}

const PREFIXES = [[1e9, 'G'], [1e6, 'M'], [1e3, 'k'], [1, ''], [1e-3, 'm'], [1e-6, 'µ']];

/** Factor and unit with the prefix that suits a value; units of one symbol take prefixes. */
export function scaled(value, unit) {
  const shown = unit === '1' ? '' : (unit || '').replace('ohm', 'Ω');
  const size = Math.abs(value);
  if (!size || !/^(W|A|V|s|Hz|Ω|J|N·m|m)(?![a-z])/.test(shown)) return [1, shown];
  const [by, letter] = PREFIXES.find(([least]) => size >= 0.9995 * least) || PREFIXES[PREFIXES.length - 1];
  return [by, letter + shown];
}

export function quantity(value, unit = '') {
  if (value == null) return '–';
  const [by, shown] = scaled(value, unit);
  return `${number(value / by)} ${shown}`.trim();
}

const LEAST = 5e-5; // W that count as nothing

/** W, in mW and kW only where three digits of W would be too few or too many. */
export const watts = (value) => (value != null && Math.abs(value) < LEAST ? '0 W' : value != null && Math.abs(value) >= 0.1 && Math.abs(value) < 1e4 ? `${number(value)} W` : quantity(value, 'W'));

export function percent(share) {
  if (share == null) return '–';
  const size = Math.abs(share);
  if (size > 0.9995 && size < 1) return 'over 99.9 %';
  return `${(100 * share).toFixed(size < 0.0995 || (size > 0.95 && size < 1) ? 1 : 0)} %`.replace('-', '−');
}

export const plural = (count, word) => `${count} ${word}${count === 1 ? '' : 's'}`;

const WIDE = 132; // px of a whisker, 18 high

/** A value with its interval as a whisker on the scale of a range that holds 0. */
export function whisker(value, [low, high], [from, to], unit) {
  const span = to - from || 1;
  const at = (x) => 4 + ((WIDE - 8) * (Math.min(Math.max(x, from), to) - from)) / span;
  const [by, shown] = scaled(Math.max(Math.abs(low), Math.abs(high)), unit);
  const text = `${number(low / by)} … ${number(high / by)} ${shown}`.trim();
  const node = h('span', { class: 'whisker', role: 'img', 'aria-label': `interval ${text}`, title: text });
  node.innerHTML = `<svg viewBox="0 0 ${WIDE} 18" width="${WIDE}" height="18"><path class="zero" d="M${at(0)} 1V17"/><path d="M${at(low)} 9H${at(high)}M${at(low)} 5V13M${at(high)} 5V13"/><circle cx="${at(value)}" cy="9" r="3.5"/></svg>`;
  return node;
}

export function download(name, text) {
  const address = URL.createObjectURL(new Blob([text], { type: 'text/csv' }));
  h('a', { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), 1000);
}

export function command(text) {
  if (!text) return null;
  const button = h('button', { type: 'button', 'aria-label': 'Copy this command' }, 'Copy');
  button.addEventListener('click', async () => {
    try {
      await navigator.clipboard.writeText(text);
      button.textContent = 'Copied';
    } catch {
      button.textContent = 'Select and copy it';
    }
    setTimeout(() => { button.textContent = 'Copy'; }, 2000);
  });
  return h('div', { class: 'with-copy' }, h('pre', { class: 'command' }, text), button);
}

/** Radio buttons that look like chips. */
export function choices(legend, name, options, value, chosen) {
  return h('fieldset', { class: 'choices' }, h('legend', {}, legend), options.map((option) => h(
    'label', { class: 'choice' },
    h('input', {
      type: 'radio', name, value: option.value, disabled: Boolean(option.disabled), checked: option.value === value,
      onchange: () => chosen(option.value),
    }),
    h('span', {}, option.label),
  )));
}

/** Do the last of many calls only, `wait` ms after it. */
export function settled(work, wait) {
  let timer;
  return (...given) => {
    clearTimeout(timer);
    timer = setTimeout(() => work(...given), wait);
  };
}
