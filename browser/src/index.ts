export { assess, type Sizes } from "./assess.js";
export { gradient, type Network, plan, type Planned } from "./decode.js";
export { govern, type Pan, panAt } from "./governor.js";
export { DT, type Friction, GRAVITY, integratePan, slideAlong, slideToRest } from "./law.js";
export { type Manifest, type Memory, open } from "./onnx.js";
export { type Limits } from "./stop.js";
