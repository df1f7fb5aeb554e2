// viser's page draws by a sky of its own until the server says otherwise, which keeps a processor that draws busy for a
// second. Ours lights its scenes itself, so that sky is never loaded: it stays on its way until it is given up.
{
  const load = window.fetch;
  window.fetch = (source, ...more) =>
    (source.url ?? String(source)).startsWith("data:image/jpeg") ? new Promise(() => {}) : load.call(window, source, ...more);
}
