// What floats over the picture keeps to it: a panel is never wider than it, or would lie over the controls beside it, and
// messages stand at its right edge.
{
  const tell = (picture) => {
    const { left, width } = picture.getBoundingClientRect();
    document.documentElement.style.setProperty("--rallyscope-picture", `${width}px`);
    document.documentElement.style.setProperty("--rallyscope-picture-right", `${left + width}px`);
  };
  const watch = () => {
    const picture = document.querySelector("#root canvas");
    if (!picture) return void setTimeout(watch, 200);
    new ResizeObserver(() => tell(picture)).observe(picture);
  };
  addEventListener("DOMContentLoaded", watch);
}
