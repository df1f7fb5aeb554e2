// What floats over the picture keeps to it: a panel is never wider than it, or would lie over the controls beside it, and
// messages stand at its right edge. The server is sent the size of the picture: viser's own report, made while the picture
// changes its size, may still hold the old one and is then not made again.
{
  let size = null;
  const send = () => size && rallyscope.send("picture", size);
  const tell = (picture) => {
    const { left, width, height } = picture.getBoundingClientRect();
    size = { width: Math.round(width), height: Math.round(height) };
    send();
    document.documentElement.style.setProperty("--rallyscope-picture", `${width}px`);
    document.documentElement.style.setProperty("--rallyscope-picture-left", `${left}px`);
    document.documentElement.style.setProperty("--rallyscope-picture-right", `${left + width}px`);
  };
  const watch = () => {
    const picture = document.querySelector("#root canvas");
    if (!picture) return void setTimeout(watch, 200);
    new ResizeObserver(() => tell(picture)).observe(picture);
  };
  const found = rallyscope.onFound;
  rallyscope.onFound = () => { found(); send(); };
  addEventListener("DOMContentLoaded", watch);
}
