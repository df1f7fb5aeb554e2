// From the first byte until the server has sent a view that is complete: a page of our own, and not the controls one by one.
{
  const REVEAL_MS = 150; // viser's messages are on another way than the word that they are complete
  const LONGEST_MS = 60_000;
  const root = document.documentElement;
  root.dataset.rallyscopeSplash = "";
  const reveal = () => { delete root.dataset.rallyscopeSplash; };
  rallyscope.handlers.ready = () => setTimeout(reveal, REVEAL_MS);
  const found = rallyscope.onFound;
  rallyscope.onFound = () => {
    found();
    root.style.setProperty("--rallyscope-splash", '"Drawing the first picture ..."');
  };
  setTimeout(reveal, LONGEST_MS); // a page that is never told shows what there is
}
