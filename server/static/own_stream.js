/** The closed loop of the page's own planner, in the place of a server's: states in, accelerations of the pan out. */

const triple = (values, k) => Array.from(values.slice(3 * k, 3 * k + 3));
const triples = (values) => Array.from({ length: values.length / 3 }, (_, k) => triple(values, k));

export class OwnStream {
  #follower = null;
  ended = false;

  /**
   * @param planner  the page's own
   * @param request  what opens a server's stream
   */
  constructor(planner, { command, friction, limits, start }) {
    this.opened = planner.follow(command.position, { friction, limits, ...(start && { start: stateOf(start) }) })
      .then((follower) => { this.#follower = follower; });
  }

  /** The chunk that follows; see `Stream.step`. */
  async step(pan, object) {
    const seen = object.length ? { executed: object.length, pan: pan.flat(), object: object.flat() } : {};
    const { u, stop } = await this.#follower.next(seen);
    return { acceleration: triples(u), brake: triples(stop) };
  }

  close() {
    this.ended = true;
    this.#follower?.end();
  }
}

const inSpace = ([x, y, z = 0]) => [x, y, z];

const stateOf = (start) => ({
  pan: [...inSpace(start.pan_position), ...inSpace(start.pan_velocity), ...inSpace(start.pan_acceleration)],
  object: [...start.object_position, ...start.object_velocity],
});
