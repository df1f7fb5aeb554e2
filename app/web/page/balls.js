// The points of the balls in Watch: a click on one opens its moment, a line drawn round some selects them, with Shift more
// of them. The server knows where the points are: it is sent places as shares of the picture's width and height.
{
  const NEAR_PX = 4, STEP_PX = 3, MOST = 1000;
  const line = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  line.id = "rallyscope-ball-line";
  line.innerHTML = "<polygon/>";
  let opened = 0;

  const follow = (event, picture) => {
    const box = picture.getBoundingClientRect(), places = [[event.clientX, event.clientY]];
    const share = ([x, y]) => [(x - box.left) / box.width, (y - box.top) / box.height].map((one) => Number(Math.min(Math.max(one, 0), 1).toFixed(4)));
    const far = (x, y, px) => Math.hypot(x - places.at(-1)[0], y - places.at(-1)[1]) >= px;
    const move = (now) => {
      if (now.pointerId !== event.pointerId || places.length >= MOST) return;
      if (!far(now.clientX, now.clientY, places.length > 1 ? STEP_PX : NEAR_PX)) return;
      places.push([now.clientX, now.clientY]);
      line.firstChild.setAttribute("points", places.join(" "));
      document.body.append(line);
    };
    const end = (now) => {
      if (now.pointerId !== event.pointerId) return;
      for (const [kind, act] of [["pointermove", move], ["pointerup", end], ["pointercancel", end]]) removeEventListener(kind, act, true);
      line.remove();
      line.firstChild.removeAttribute("points");
      if (now.type !== "pointerup") return;
      if (places.length === 1) rallyscope.send("ball_point", { at: share(places[0]) });
      else rallyscope.send("ball_outline", { outline: places.map(share), more: now.shiftKey });
    };
    for (const [kind, act] of [["pointermove", move], ["pointerup", end], ["pointercancel", end]]) addEventListener(kind, act, true);
  };

  addEventListener("pointerdown", (event) => {
    const picture = event.target instanceof Element && event.target.closest("[data-rallyscope-balls]");
    if (!picture || event.button !== 0) return;
    event.preventDefault();
    follow(event, picture);
  });

  rallyscope.handlers.open_ball = ({ link, number }) => {
    if (number <= opened) return; // what is known is sent again where the socket broke
    opened = number;
    location.hash = link;
  };
}
