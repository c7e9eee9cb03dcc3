/** Keeps the page and its planner for when there is no network; a new version of the site takes the place of the old. */

declare const VERSION: string;
declare const FILES: readonly string[];

const scope = self as unknown as ServiceWorkerGlobalScope;

scope.addEventListener("install", (event) => {
  event.waitUntil(caches.open(VERSION).then((cache) => cache.addAll([...FILES])).then(() => scope.skipWaiting()));
});

scope.addEventListener("activate", (event) => {
  const drop = async (): Promise<void> => {
    for (const name of await caches.keys()) if (name !== VERSION) await caches.delete(name);
    await scope.clients.claim();
  };
  event.waitUntil(drop());
});

scope.addEventListener("fetch", (event) => {
  if (event.request.method !== "GET") return;
  event.respondWith(caches.match(event.request, { ignoreSearch: true }).then((kept) => kept ?? fetch(event.request)));
});

export {};
