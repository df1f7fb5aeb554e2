// The address shows what is looked at: a link that another can open. Another mode or another recording is a step of the
// browser's history, so Back and Forward go through them; all else, such as the time, replaces the address of the step.
{
  const WAIT_MS = 10_000;
  let shown = null; // mode and recording of the current step
  let awaited = null, since = 0; // those that Back or Forward asked for: until they come, links are of what was left

  const placeOf = (link) => {
    const values = new URLSearchParams(link);
    return JSON.stringify([values.get("recording"), values.get("mode") ?? "Watch"]);
  };

  rallyscope.handlers.link = ({ link }) => {
    const place = placeOf(link);
    if (awaited !== null && place !== awaited && performance.now() - since < WAIT_MS) return;
    awaited = null;
    const isStep = shown !== null && place !== shown;
    const address = location.pathname + location.search + "#" + link;
    shown = place;
    rallyscope.link = link;
    history[isStep ? "pushState" : "replaceState"]({ ...history.state, rallyscope: true }, "", address);
  };

  addEventListener("popstate", (event) => {
    const link = location.hash.slice(1);
    if (!event.state?.rallyscope || !link) return; // typed, or followed: that is a link like any other
    rallyscope.link = link;
    shown = awaited = placeOf(link);
    since = performance.now();
    rallyscope.send("go_to_link", { link });
  });

  addEventListener("hashchange", () => {
    const link = location.hash.slice(1);
    if (link && link !== rallyscope.link) rallyscope.send("open_link", { link });
  });
}
