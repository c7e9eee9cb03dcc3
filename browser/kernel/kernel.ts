/**
 * What the network is made of, in AssemblyScript: products of 8-bit weights, and the gates of an LSTM.
 *
 * Sums of integers are exact, and each float32 step is rounded as onnxruntime rounds it on a processor with fused
 * multiply-add, which it needs no instruction for: the product of two float32 is exact in float64. So the 8-bit steps
 * that activations are rounded to are the same ones, and a plan is that of the Python runtime.
 *
 * All arguments are addresses and numbers of elements.
 */

// @ts-ignore: decorator
@inline
const LANES: i32 = 8;

/**
 * out[row][o] = sum over k of weights[o][k] x[row][k], in 32 bits.
 *
 * @param weights (outputs, inputs) of 8 bits
 * @param x (rows, inputs) of 16 bits
 * @param inputs a multiple of 8
 * @param outputs a multiple of 4
 * @param rows 1 or 2
 */
export function multiply(weights: usize, x: usize, out: usize, inputs: i32, outputs: i32, rows: i32): void {
  for (let o = 0; o < outputs; o += 4) {
    const w: usize = weights + o * inputs;
    if (rows == 1) four(w, x, inputs, out + 4 * o);
    else eight(w, x, inputs, out + 4 * o, out + 4 * (outputs + o));
  }
}

/** Four outputs of one row. */
// @ts-ignore: decorator
@inline
function four(w0: usize, x: usize, inputs: i32, out: usize): void {
  const w1 = w0 + inputs, w2 = w1 + inputs, w3 = w2 + inputs;
  let a = i32x4.splat(0), b = a, c = a, d = a;
  for (let k = 0; k < inputs; k += LANES) {
    const seen = v128.load(x + 2 * k);
    a = i32x4.add(a, i32x4.dot_i16x8_s(v128.load_ext<i8>(w0 + k), seen));
    b = i32x4.add(b, i32x4.dot_i16x8_s(v128.load_ext<i8>(w1 + k), seen));
    c = i32x4.add(c, i32x4.dot_i16x8_s(v128.load_ext<i8>(w2 + k), seen));
    d = i32x4.add(d, i32x4.dot_i16x8_s(v128.load_ext<i8>(w3 + k), seen));
  }
  v128.store(out, sums(a, b, c, d));
}

/** Four outputs of two rows: each weight is loaded once for both. */
// @ts-ignore: decorator
@inline
function eight(w0: usize, x: usize, inputs: i32, out: usize, second: usize): void {
  const w1 = w0 + inputs, w2 = w1 + inputs, w3 = w2 + inputs, y = x + 2 * inputs;
  let a = i32x4.splat(0), b = a, c = a, d = a, e = a, f = a, g = a, h = a;
  for (let k = 0; k < inputs; k += LANES) {
    const seen = v128.load(x + 2 * k), too = v128.load(y + 2 * k);
    let w = v128.load_ext<i8>(w0 + k);
    a = i32x4.add(a, i32x4.dot_i16x8_s(w, seen));
    e = i32x4.add(e, i32x4.dot_i16x8_s(w, too));
    w = v128.load_ext<i8>(w1 + k);
    b = i32x4.add(b, i32x4.dot_i16x8_s(w, seen));
    f = i32x4.add(f, i32x4.dot_i16x8_s(w, too));
    w = v128.load_ext<i8>(w2 + k);
    c = i32x4.add(c, i32x4.dot_i16x8_s(w, seen));
    g = i32x4.add(g, i32x4.dot_i16x8_s(w, too));
    w = v128.load_ext<i8>(w3 + k);
    d = i32x4.add(d, i32x4.dot_i16x8_s(w, seen));
    h = i32x4.add(h, i32x4.dot_i16x8_s(w, too));
  }
  v128.store(out, sums(a, b, c, d));
  v128.store(second, sums(e, f, g, h));
}

/** The sum of each of four vectors. */
// @ts-ignore: decorator
@inline
function sums(a: v128, b: v128, c: v128, d: v128): v128 {
  const ab = i32x4.add(i32x4.shuffle(a, b, 0, 4, 1, 5), i32x4.shuffle(a, b, 2, 6, 3, 7));
  const cd = i32x4.add(i32x4.shuffle(c, d, 0, 4, 1, 5), i32x4.shuffle(c, d, 2, 6, 3, 7));
  return i32x4.add(i32x4.shuffle(ab, cd, 0, 1, 4, 5), i32x4.shuffle(ab, cd, 2, 3, 6, 7));
}

/** out = x in steps, as whole numbers from -zero to 255 - zero, of 16 bits; ties go to the even one. */
export function quantize(x: usize, n: i32, step: f32, zero: f32, out: usize): void {
  for (let k = 0; k < n; k++) {
    const steps = nearest<f32>(load<f32>(x + 4 * k) / step);
    store<i16>(out + 2 * k, i16(max<f32>(-zero, min<f32>(255 - zero, steps))));
  }
}

/** out = totals of `multiply` times what one is worth, with `out` added unless it is the first. */
export function scaled(totals: usize, scale: usize, out: usize, n: i32, first: bool): void {
  for (let k = 0; k < n; k++) {
    const value: f32 = f32(load<i32>(totals + 4 * k)) * load<f32>(scale + 4 * k);
    store<f32>(out + 4 * k, first ? value : load<f32>(out + 4 * k) + value);
  }
}

/** out += x */
export function add(x: usize, out: usize, n: i32): void {
  for (let k = 0; k < n; k++) store<f32>(out + 4 * k, load<f32>(out + 4 * k) + load<f32>(x + 4 * k));
}

/**
 * One step of an LSTM.
 *
 * @param gates (4, units) what goes into the gates: input, output, forget, new
 * @param cell (units) in place
 * @param hidden (units) out
 */
export function step(gates: usize, cell: usize, hidden: usize, units: i32): void {
  const size: usize = 4 * units;
  for (let k: usize = 0; k < size; k += 4) {
    const input = logistic(load<f32>(gates + k)), output = logistic(load<f32>(gates + size + k));
    const kept: f32 = logistic(load<f32>(gates + 2 * size + k)) * load<f32>(cell + k);
    const added: f32 = input * tanh(load<f32>(gates + 3 * size + k));
    const next: f32 = kept + added;
    store<f32>(cell + k, next);
    store<f32>(hidden + k, tanh(next) * output);
  }
}

/** x = tanh x */
export function bend(x: usize, n: i32): void {
  for (let k = 0; k < n; k++) store<f32>(x + 4 * k, tanh(load<f32>(x + 4 * k)));
}

/** a b + c, rounded once. */
// @ts-ignore: decorator
@inline
function fused(a: f32, b: f32, c: f32): f32 {
  return f32(f64(a) * f64(b) + f64(c));
}

/** tanh by the rational approximation of Eigen that onnxruntime uses. */
// @ts-ignore: decorator
@inline
function tanh(value: f32): f32 {
  const x: f32 = max<f32>(-9, min<f32>(9, value)), square: f32 = x * x;
  let p = fused(square, -2.76076847742355e-16, 2.00018790482477e-13);
  p = fused(p, square, -8.60467152213735e-11);
  p = fused(p, square, 5.12229709037114e-08);
  p = fused(p, square, 1.48572235717979e-05);
  p = fused(p, square, 6.37261928875436e-04);
  p = fused(p, square, 4.89352455891786e-03);
  let q = fused(square, 1.19825839466702e-06, 1.18534705686654e-04);
  q = fused(q, square, 2.26843463243900e-03);
  q = fused(q, square, 4.89352518554385e-03);
  return (p * x) / q;
}

/** 1/(1 + exp(-x)), from the same place. */
// @ts-ignore: decorator
@inline
function logistic(value: f32): f32 {
  const x: f32 = max<f32>(-18, min<f32>(18, value)), square: f32 = x * x;
  let p = fused(square, 4.37031012579801e-11, 1.15627324459942e-07);
  p = fused(p, square, 6.08574864600143e-05);
  p = fused(p, square, 8.51377133304701e-03);
  p = fused(p, square, 2.48287947061529e-01);
  let q = fused(square, 6.10247389755681e-13, 5.76102136993427e-09);
  q = fused(q, square, 6.29106785017040e-06);
  q = fused(q, square, 1.70198817374094e-03);
  q = fused(q, square, 1.16817656904453e-01);
  q = fused(q, square, 9.93151921023180e-01);
  return max<f32>(0, min<f32>(1, (p * x) / q + 0.5));
}
