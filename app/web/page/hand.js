// Whether a person's hand is at the picture: the server sees only that the camera moved, not who moved it.
{
  let told = 0;
  const tell = () => {
    if (performance.now() - told < 300) return;
    told = performance.now();
    rallyscope.send("hand");
  };
  const atPicture = (event) => event.target instanceof Element && event.target.closest("#root canvas");
  for (const kind of ["pointerdown", "wheel"])
    addEventListener(kind, (event) => { if (atPicture(event)) tell(); }, { capture: true, passive: true });
  addEventListener("pointermove", (event) => { if (event.buttons && atPicture(event)) tell(); }, { capture: true, passive: true });
  addEventListener("keydown", (event) => {
    if (/^(Key[WASDQE]|Arrow\w+)$/.test(event.code) && !event.target.closest("input, textarea, select")) tell();
  }, true);
}
