// Who draws the pictures: where no graphics card does, the processor draws every one of them, with all the rest of the page,
// and a live rally that runs on it, too, needs that time. The server then sends fewer; what moves by itself here does so less.
{
  const drawer = () => {
    const context = document.createElement("canvas").getContext("webgl2");
    if (!context) return "software";
    const told = context.getExtension("WEBGL_debug_renderer_info");
    const name = String(context.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : context.RENDERER));
    context.getExtension("WEBGL_lose_context")?.loseContext();
    return name;
  };
  rallyscope.bySoftware = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(drawer());
  const found = rallyscope.onFound;
  rallyscope.onFound = () => { found(); rallyscope.send("drawing", { software: rallyscope.bySoftware }); };
}
