// A double click on a camera's picture beside the scene puts it into the middle; one on the picture there gives the scene
// back. The server knows what is a camera: it is told the words that stand with the picture.
{
  const captionOf = (picture) => {
    let row = picture.parentElement;
    for (let up = 0; row && up < 3; up += 1, row = row.parentElement) {
      const caption = row.textContent.trim();
      if (caption) return caption;
    }
    return null;
  };

  addEventListener("dblclick", (event) => {
    if (!(event.target instanceof Element)) return;
    const picture = event.target.closest("#root img");
    const camera = picture ? captionOf(picture) : event.target.closest("#root canvas") ? "" : null;
    if (camera !== null) rallyscope.send("enlarge", { camera });
  });
}
