/** A server's closed loop (`WS /stream`): states in, accelerations of the pan out. */

const PATIENCE = 5000;  // ms until an answer that does not come is given up

const SUBPROTOCOL = "slide-stream";
/** A token as the name of a subprotocol: a page can send no header when it opens a stream. */
const bearer = (token) => {
  const text = btoa(String.fromCharCode(...new TextEncoder().encode(token)));
  return `bearer.${text.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "")}`;
};

const UNREADABLE = "The server’s answer is none that this page can read.";
const areRows = (rows) => Array.isArray(rows) && rows.every((row) => row.length === 3 && row.every(Number.isFinite));

export class Stream {
  #socket;
  #answers = [];  // of what was sent and is not answered: {resolve, reject}
  #sequence = 0;
  #why = "The server cannot be reached, or takes no more streams now.";
  #ended = false;

  /**
   * @param request  what opens a stream, without its format
   * @param token  of the server; "" where it wants none
   */
  constructor(request, token = "") {
    const address = new URL("stream", location.href);
    address.protocol = address.protocol.replace("http", "ws");
    address.hash = "";
    this.#socket = new WebSocket(address, token ? [SUBPROTOCOL, bearer(token)] : []);
    this.#socket.addEventListener("message", ({ data }) => this.#take(data));
    this.#socket.addEventListener("close", () => this.#end());
    this.opened = this.#asked();
    this.#socket.addEventListener("open", () => {
      this.#why = "The connection to the server is lost.";
      this.#socket.send(JSON.stringify({ format: "slide-stream/2", ...request }));
    });
  }

  /** Whether it can no longer be asked. */
  get ended() {
    return this.#ended;
  }

  /**
   * The chunk that follows.
   *
   * @param pan  rows [x, y, z, vx, vy, vz] of it since the last step; none before the first
   * @param object  rows [x, y, vx, vy] of it, relative to the pan
   * @returns {acceleration, brake, status}
   * @throws Error, in words to be shown
   */
  async step(pan, object) {
    const answer = this.#asked();
    if (!this.#ended) this.#socket.send(JSON.stringify({ sequence: this.#sequence, pan, object }));
    this.#sequence += 1;
    const chunk = await answer;
    if ([chunk.acceleration, chunk.brake].every(areRows) && chunk.acceleration.length) return chunk;
    this.close();
    throw new Error(UNREADABLE);
  }

  close() {
    this.#socket.close();
    this.#end();
  }

  #asked() {
    const answer = new Promise((resolve, reject) => this.#answers.push({ resolve, reject }));
    answer.catch(() => undefined);  // who waits is told; nobody may wait for the first
    if (this.#ended) this.#end();
    else setTimeout(() => this.#late(answer), PATIENCE);
    answer.then(() => { answer.settled = true; }, () => { answer.settled = true; });
    return answer;
  }

  #late(answer) {
    if (answer.settled) return;
    this.#why = `The server has not answered for ${PATIENCE / 1e3} s.`;
    this.close();
  }

  #take(data) {
    let message;
    try {
      message = JSON.parse(data);
    } catch {
      message = null;
    }
    if (message?.chunk || message?.acceleration) {
      this.#answers.shift()?.resolve(message);
      return;
    }
    const { title, detail } = message ?? {};
    this.#why = title ? `The server ended it: ${[title, detail].filter(Boolean).join(": ")}.` : UNREADABLE;
    this.close();
  }

  #end() {
    this.#ended = true;
    for (const { reject } of this.#answers.splice(0)) reject(new Error(this.#why));
  }
}
