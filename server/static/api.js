/** Who plans for this page: the server behind it, or, where there is none, the page itself; and what goes wrong. */

const PATIENCE = 30_000;  // ms until an answer that does not come is given up
const STARTING = 30;  // s that a server may take to start

/** What went wrong, in words to be shown as they are. */
export class Refusal extends Error {
  constructor(message, status = 0) {
    super(message);
    this.status = status;
  }
}

const megabytes = (bytes) => (bytes / 1e6).toFixed(1);

const WORDS = {
  400: "The server did not understand the request.",
  401: "This server plans only for those who have its token.",
  403: "This server does not accept that token.",
  408: "The request did not reach the server in time. Try again.",
  413: "This path is too long for the server. Draw a shorter one, or choose a higher speed.",
  422: "The server cannot plan this path.",
  429: "That was too much at once.",
  500: "Something broke inside the server. The path is kept; try again, and tell whoever runs it if it stays so.",
  503: "The server has its hands full.",
  504: "Planning took longer than the server allows. Draw a shorter path, or try again.",
};

/** Read an answer that is not a plan: an RFC 9457 problem document, or whatever a proxy put in its place. */
async function refusalOf(response) {
  const problem = await response.json().catch(() => null);
  const detail = typeof problem?.detail === "string" ? ` ${problem.detail.replace(/[^.!?]$/, "$&.")}` : "";
  const words = WORDS[response.status] ?? `The server answered with status ${response.status}.`;
  const wait = Number(response.headers.get("Retry-After"));
  const again = wait > 0 ? ` Try again in ${wait} s.` : [429, 503].includes(response.status) ? " Try again soon." : "";
  const told = [400, 403, 413, 422].includes(response.status) ? detail : "";
  return new Refusal(words + told + again, response.status);
}

/**
 * Send something, and return the answer's text.
 *
 * @throws Refusal; the DOMException "AbortError" once `signal` says so
 */
async function send(path, body, type, token, signal) {
  const headers = { "Content-Type": type };
  if (token) headers.Authorization = `Bearer ${token}`;
  const late = new AbortController(), timer = setTimeout(() => late.abort(), PATIENCE);
  signal?.addEventListener("abort", () => late.abort());
  try {
    const response = await fetch(path, { method: "POST", headers, body, signal: late.signal });
    if (!response.ok) throw await refusalOf(response);
    return await response.text();
  } catch (error) {
    if (error instanceof Refusal || signal?.aborted) throw error;
    if (error.name === "AbortError") {
      throw new Refusal(`The server has not answered for ${PATIENCE / 1e3} s. The path is kept; try again.`);
    }
    throw new Refusal("The server cannot be reached: it may have been stopped. The path is kept; start the server " +
      "(slide-serve) and press Plan again.");
  } finally {
    clearTimeout(timer);
  }
}

/**
 * Ask for a plan.
 *
 * @returns {text, plan, took}: the document as it came, parsed, and the milliseconds from question to answer
 * @throws as `send`
 */
export async function requestPlan(body, token, signal) {
  const began = performance.now();
  const text = await send("plan", body, "application/json", token, signal);
  const took = performance.now() - began;
  try {
    const plan = JSON.parse(text);
    if (!plan.format.startsWith("slide-plan/")) throw new SyntaxError(plan.format);
    return { text, plan, took };
  } catch {
    throw new Refusal("The server’s answer is no plan that this page can read.");
  }
}

/**
 * Let the server read a file: a drawing, or a recording, at the speed (m/s) that is wanted where it says none.
 *
 * @param most  bytes that the server takes
 * @returns {positions, notes}: [[x, y], ...] in metres, every millisecond, and what was made of the file
 * @throws as `send`
 */
export async function requestCommand(file, speed, token, most = Infinity) {
  if (file.size > most) {
    throw new Refusal(`This file has ${megabytes(file.size)} MB, and the server takes at most ${megabytes(most)} MB.`);
  }
  const ask = (query) => send(`command${query}`, file, "application/octet-stream", token);
  let text;
  try {
    text = await ask("");
  } catch (error) {
    if (!(error instanceof Refusal) || !error.message.includes("--speed")) throw error;
    text = await ask(`?speed=${speed}&size=0.1`);
  }
  const { command, notes } = JSON.parse(text);
  return { positions: command.position, notes };
}

/**
 * What the server says of itself, once it has started; or null: the page works without.
 *
 * @param token  of the server
 * @param locked  () is called where it wants another token
 */
export async function requestInfo(token, locked) {
  const headers = token ? { Authorization: `Bearer ${token}` } : {};
  try {
    for (let tries = 0; tries < STARTING; tries++) {
      const response = await fetch("info", { headers });
      if (response.ok) return await response.json();
      if (response.status === 401) locked();
      if (response.status !== 503) break;
      await new Promise((resolve) => setTimeout(resolve, 1000));
    }
  } catch {
    // nothing is there that answers
  }
  return null;
}

/**
 * The planner that came with the page, where no server is behind it; null if none did.
 *
 * @param report is told how far it is loaded, in words to be shown
 * @returns {info, plan}: what a server's `info` has, and what plans positions at 1 kHz under a friction
 * @throws Refusal
 */
export async function localPlanner(report) {
  const module = document.querySelector("meta[name=planner]")?.content;
  if (!module) return null;
  try {
    return await (await import(new URL(module, document.baseURI))).start(report);
  } catch (error) {
    throw new Refusal(error.message);
  }
}

/** The same request for a terminal. */
export function curlOf(body, withToken) {
  const token = withToken ? " -H \"Authorization: Bearer $SLIDE_TOKEN\"" : "";
  return `curl ${new URL("plan", location.href)} -H 'Content-Type: application/json'${token} -o plan.json -d '${body}'`;
}
