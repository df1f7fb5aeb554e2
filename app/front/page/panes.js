// A panel that floats over the picture is never wider than that: it would lie over the controls beside it.
{
  const tell = (width) => document.documentElement.style.setProperty("--rallyscope-picture", `${width}px`);
  const watch = () => {
    const picture = document.querySelector("#root canvas");
    if (!picture) return void setTimeout(watch, 200);
    new ResizeObserver(([entry]) => tell(entry.contentRect.width)).observe(picture);
  };
  addEventListener("DOMContentLoaded", watch);
}
