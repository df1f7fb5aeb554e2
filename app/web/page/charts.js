// A chart of several seeds shows their band. While the mouse is over it, it shows the line of every seed, and names the
// nearest one. viser's page keeps its charts under a name for its own tests: there is no other way to them.
{
  const NEAR_PX = 12;
  const tip = document.createElement("div");
  tip.id = "rallyscope-chart-tip";
  tip.hidden = true;
  let chart = null, seeds = [];

  const charts = () => Object.values(window.__viserTestpoints?.uplots ?? {}).map((one) => one.chart);
  const show = (shown) => chart.batch(() => {
    for (const k of seeds) chart.setSeries(k, { show: shown });
    if (!shown) chart.setSeries(null, { focus: true });
  });

  const enter = (found) => {
    if (chart && charts().includes(chart)) show(false); // one that was made anew shows none
    tip.hidden = true;
    chart = found;
    seeds = found ? found.series.flatMap((one, k) => (/^seed /.test(one.label) ? [k] : [])) : [];
    if (seeds.length) show(true);
  };

  const name = (event) => {
    const box = chart.over.getBoundingClientRect(), at = chart.posToIdx(event.clientX - box.left);
    let nearest = null, least = NEAR_PX;
    for (const k of seeds) {
      const value = chart.data[k][at];
      if (value == null || Number.isNaN(value)) continue;
      const away = Math.abs(chart.valToPos(value, chart.series[k].scale) - (event.clientY - box.top));
      if (away < least) [nearest, least] = [k, away];
    }
    chart.setSeries(nearest, { focus: true });
    tip.hidden = nearest === null;
    if (tip.hidden) return;
    tip.textContent = `${chart.series[nearest].label}: ${Number(chart.data[nearest][at].toPrecision(3))} at ball ${chart.data[0][at]}`;
    tip.style.left = `${Math.min(event.clientX + 12, innerWidth - tip.offsetWidth - 4)}px`;
    tip.style.top = `${event.clientY - 26}px`;
  };

  addEventListener("pointermove", (event) => {
    const over = event.target instanceof Element ? event.target.closest(".u-over") : null;
    const found = over ? charts().find((one) => one.over === over) ?? null : null;
    if (found !== chart) enter(found);
    if (seeds.length) name(event);
  });
  addEventListener("DOMContentLoaded", () => document.body.append(tip));
}
