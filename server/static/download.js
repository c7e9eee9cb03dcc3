/** What can be taken along: the plan as a file, the request as a line for a terminal. */

import { $ } from "./viewer/dom.js";

/** Hand the browser a file to save. */
export function saveFile(name, text) {
  const address = URL.createObjectURL(new Blob([text], { type: "application/json" }));
  const link = Object.assign(document.createElement("a"), { href: address, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** Copy the line in #curl, or, where the browser forbids it (no https, not this machine), select it to be copied. */
export async function copyCurl() {
  const line = $("curl");
  try {
    await navigator.clipboard.writeText(line.textContent);
    $("copied").textContent = "Copied.";
  } catch {
    line.closest("details").open = true;
    line.focus();
    getSelection().selectAllChildren(line);
    $("copied").textContent = "Selected below: copy it with your keyboard.";
  }
  setTimeout(() => { $("copied").textContent = ""; }, 4000);
}
