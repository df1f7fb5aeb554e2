// The app takes Enter and Space as keys of its own, and viser, which listens at the root of the page, then keeps them from
// the button that has the focus. So they end here, one step before, for a button that was reached by Tab; one that was
// clicked leaves them to the app, so that Space after a click still plays.
addEventListener("DOMContentLoaded", () => {
  document.body.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== " ") return;
    const button = event.target.closest("button, a[href], summary, input[type=checkbox], [role=button], [role=tab], [role=switch]");
    if (button && button.matches(":focus-visible")) event.stopPropagation();
  });
});
