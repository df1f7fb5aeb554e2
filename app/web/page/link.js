// The address shows what is looked at: a link that another can open.
rallyscope.handlers.link = (message) => {
  rallyscope.link = message.link;
  history.replaceState(history.state, "", location.pathname + location.search + "#" + message.link);
};

addEventListener("hashchange", () => {
  const link = location.hash.slice(1);
  if (link && link !== rallyscope.link) rallyscope.send("open_link", { link });
});
