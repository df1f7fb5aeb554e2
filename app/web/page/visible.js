// Whether the page can be seen: what runs only for those who watch pauses behind another tab.
{
  const report = () => rallyscope.send("visible", { visible: document.visibilityState !== "hidden" });
  document.addEventListener("visibilitychange", report);
  const found = rallyscope.onFound;
  rallyscope.onFound = () => { found(); report(); };
}
