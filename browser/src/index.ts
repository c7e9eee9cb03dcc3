export { assess, type Sizes } from "./assess.js";
export { type Command, readCommand } from "./command.js";
export { type Asked, plan, type Planned, type Start, startAt } from "./decode.js";
export { type Chunk, Following, type Seen } from "./follow.js";
export { govern, type Governed, type Pan, panAt, panAtStart } from "./governor.js";
export { DT, type Friction, GRAVITY, integratePan, slideAlong, slideToRest } from "./law.js";
export { type LimitsAsked, limitsOf } from "./limits.js";
export { type Manifest, type Memory, type Network, open } from "./network.js";
export { type Limits, type PanState } from "./stop.js";
