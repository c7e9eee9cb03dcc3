/** Frames: what waits for the next one, and what waits until something moves. */

const LATEST = 300;  // ms until what waits is done where no frame is drawn, as in a tab behind others, or none to spare

/** Return what has `work` done with the next frame, once however often it is called before. */
export function withNextFrame(work) {
  let waits = false;
  return () => {
    if (waits) return;
    waits = true;
    requestAnimationFrame(() => {
      waits = false;
      work();
    });
  };
}

/** Wait until what begins to play now has moved: page and server may share a processor. */
export const moved = () => new Promise((resolve) => {
  setTimeout(resolve, LATEST);
  requestAnimationFrame(() => requestAnimationFrame(resolve));
});

/** Do work in pieces, as long as `work` returns true, once what plays has moved, and where there is time to spare. */
export async function later(work) {
  await moved();
  const idle = globalThis.requestIdleCallback ?? setTimeout;
  const goOn = () => idle(() => work() === true && goOn(), { timeout: LATEST });
  goOn();
}
