/** The closed loop of the page's own planner, in the place of a server's: states in, accelerations of the pan out. */

const triples = (values) => Array.from({ length: values.length / 3 }, (_, k) => Array.from(values.slice(3 * k, 3 * k + 3)));

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

const stateOf = ({ pan_position: at, pan_velocity: moving, pan_acceleration: pushed, object_position: x, object_velocity: v }) =>
  ({ pan: [...inSpace(at), ...inSpace(moving), ...inSpace(pushed)], object: [...x, ...v] });
