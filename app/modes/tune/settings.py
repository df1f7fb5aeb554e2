"""The controls of Tune: which window is looked at, the settings of a method, and config files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import viser

from app import theme
from app.formatting import html_text, percent
from app.modes.tune.commands import SetSpaceColour, ShowEventsInSpace, ShowFramesBeside
from app.panels.field_control import add_field_control, section_title
from app.state.client_state import SLOTS, SPACE_COLOURS, ClientState
from app.state.commands import (
    ZOOM_RANGE,
    Command,
    CopyToOther,
    EditSetting,
    LookAt,
    Redo,
    ResetAllConfigs,
    ResetConfig,
    SetCamera,
    SetCompare,
    SetMethod,
    SetOverlay,
    SetSlot,
    SetZoom,
    Undo,
)
from app.state.config_words import ShowChangedConfig, changed_configs, changed_words
from app.widgets import Choice, Listing, when_changed, when_clicked
from core.config import FieldSpec, field_specs, get_setting, replace_setting
from core.detection import DetectorConfig
from core.detection.method_trace import MethodTrace, StageCount, setting_group
from core.detection.methods import DEFAULT_METHOD, METHODS, SECTIONS, VIEWS, Method
from core.errors import ConfigError
from core.tuning.parameters import tunable_parameters

FOLDED = ("hot_pixels", "flicker", "roi")
"""Sections that start folded: optional stages, and what rarely needs a change."""
OPTIONAL = ("hot_pixels", "flicker")
"""Stages that may be off."""
NO_FRAMES: Final = "none"
REST_S: Final = 1.0
"""A value that conflicts with others (a 3 on the way to 30) is checked after this long without typing."""


class SettingsPanel:
    """Sliders of one browser for every field of the detector config; those that the chosen method takes are shown."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        self._handles: dict[tuple[str, ...], viser.GuiInputHandle] = {}
        self._counts: dict[str, viser.GuiHtmlHandle] = {}
        self._groups: dict[str, viser.GuiFolderHandle] = {}
        self._shown: Method | None = None
        self._first: str | None = None
        self._wanted = ""
        self._send = send
        self._config = DetectorConfig()
        self._held = DebouncedEdit()
        self._group_of: dict[str, str] = {}
        self.folder = gui.add_folder("Detector")
        with self.folder:
            self._method = gui.add_dropdown("Method", tuple(METHODS), hint="The detector that is tuned")
            edit = gui.add_button_group(
                "Edit",
                ("Undo", "Redo", "Reset", "Copy"),
                hint="Z undoes, R redoes; Reset: this method's config; Copy gives A's values to B or B's to A",
            )
            self._add_groups(gui)
        self._orders = {group: folder.order for group, folder in self._groups.items()}
        when_changed(self._method, lambda method: send(SetMethod(method)))  # type: ignore[arg-type]

        @edit.on_click
        async def _(event: viser.GuiEvent) -> None:
            commands = {"Undo": Undo(), "Redo": Redo(), "Reset": ResetConfig(), "Copy": CopyToOther()}
            send(commands[str(event.target.value)])

    def _add_groups(self, gui: viser.GuiApi) -> None:
        """A folder for each section, or for each stage in a section that has several, in the order of the stages."""
        specs = field_specs(DetectorConfig)
        for section, stage in dict.fromkeys((spec.path[0], spec.stage) for spec in specs):
            group = setting_group(section, stage)
            title = section_title((stage or section,))
            self._groups[group] = gui.add_folder(title, expand_by_default=section not in FOLDED)
            with self._groups[group]:
                gui.add_html(anchor_html(stage_anchor(group)))
                self._counts[group] = gui.add_html("")
                for spec in specs:
                    if (spec.path[0], spec.stage) == (section, stage):
                        gui.add_html(anchor_html(setting_anchor(".".join(spec.path))))
                        handle = self._handles[spec.path] = add_field_control(gui, spec, slider=True)
                        when_changed(handle, lambda value, spec=spec: self._edit(spec, value))

    def show(self, state: ClientState) -> None:
        """Show the sliders of the chosen method, where the config of the chosen slot is."""
        self._method.value = state.tune.method
        if state.tune.method != self._shown:
            self._shown = state.tune.method
            self._offer(state.tune.method)
        if self._wanted != state.tune.stage:
            self._wanted = state.tune.stage
            self._first_of_view()
        self._config, held = state.config, self._held.edit
        for path, handle in self._handles.items():
            if held is None or path != held.path:
                handle.value = get_setting(state.config, path)

    def tick(self, wall_s: float) -> None:
        """Send the held edit once typing has stopped; a refusal is shown."""
        if (edit := self._held.rested(wall_s)) is not None:
            self._send(edit)

    def _edit(self, spec: FieldSpec, value: object) -> None:
        if is_half_typed(spec, value):
            return
        edit = EditSetting(spec.path, value)  # type: ignore[arg-type]
        if not self._held.hold(edit, self._config):
            self._send(edit)

    def _first_of_view(self) -> None:
        """Move the sliders of the stage that is shown to the top."""
        self._put_first(self._group_of.get(self._wanted))

    def _put_first(self, group: str | None) -> None:
        """Move the sliders of a group to the top; the others keep their order."""
        if group == self._first:
            return
        for name in (self._first, group):
            if name is not None:
                above = min(self._orders.values()) - 0.5
                self._groups[name].order = above if name == group else self._orders[name]
        self._first = group

    def _offer(self, method: Method) -> None:
        """Show the fields of the config that this method uses."""
        self._method.hint = f"{method}: {METHODS[method]}"  # no line of its own: the sliders are to be in reach
        taken = {parameter.spec.path for parameter in tunable_parameters(method, DetectorConfig())}
        of_group = {setting_group(spec.path[0], spec.stage): [] for spec in field_specs(DetectorConfig)}
        for spec in field_specs(DetectorConfig):
            of_group[setting_group(spec.path[0], spec.stage)].append(spec.path)
        for name, folder in self._groups.items():
            paths = of_group[name]
            folder.visible = paths[0][0] in SECTIONS[method] and any(path in taken for path in paths)
        for path, handle in self._handles.items():
            handle.visible = path in taken

    def show_trace(self, trace: MethodTrace | None) -> None:
        """Show what came into every stage and out of it, and its time; nothing without a trace."""
        for name, html in self._counts.items():
            count = trace.counts.get(name) if trace else None
            off = trace is not None and name in OPTIONAL
            html.content = stage_counts_html("off" if off else "") if count is None else count_html(count)
        if trace is not None:
            self._group_of = {view.name: view.group for view in trace.views if view.group in self._groups}
            self._first_of_view()


def count_html(count: StageCount) -> str:
    """One line with what came into a stage, what it kept, and its time; the page greys it while it is outdated."""
    if count.not_run:
        return f"<div class='rallyscope-answer rallyscope-count'>{stage_counts_html(html_text(count.not_run))}</div>"
    alike = count.unit_in in ("", count.unit)
    share = f" ({percent(count.count_out / count.count_in)})" if alike and count.count_in else ""
    unit_in = count.unit_in[:-1] if count.count_in == 1 and count.unit_in.endswith("s") else count.unit_in
    before = f"{count.count_in}" if alike else f"{count.count_in} {html_text(unit_in)}"
    seconds = "" if count.seconds is None else f" &middot; {count.seconds * 1e3:.2f} ms"
    kept = f"{before} &rarr; <b>{count.count_out}</b> {html_text(count.unit)}{share}{seconds}"
    whole = f"{before} &rarr; {count.count_out} {html_text(count.unit)}{share}{seconds}"  # where a line is cut
    return f"<div class='rallyscope-answer rallyscope-count' title='{whole}'>{stage_counts_html(kept)}</div>"


class DebouncedEdit:
    """The last edit, if the config refuses it: perhaps the number is only half typed."""

    def __init__(self) -> None:
        self.edit: EditSetting | None = None
        self._waiting: EditSetting | None = None
        self._since_s = 0.0

    def hold(self, edit: EditSetting, config: DetectorConfig) -> bool:
        """Hold an edit if it would be refused. A valid edit of the same setting replaces the held one."""
        try:
            replace_setting(config, edit.path, edit.value)
        except ConfigError:
            self.edit = edit
            return True
        if self.edit is not None and self.edit.path == edit.path:
            self.edit = None
        return False

    def rested(self, wall_s: float) -> EditSetting | None:
        """Release and return an edit that was held for REST_S."""
        edit = self.edit
        if edit is not self._waiting:
            self._waiting, self._since_s = edit, wall_s
        if edit is None or wall_s - self._since_s < REST_S:
            return None
        self.edit = self._waiting = None
        return edit


def is_half_typed(spec: FieldSpec, value: object) -> bool:
    """Whether a number is outside its box's range; the box itself clamps it when it loses focus."""
    if spec.bounds is None or isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return not spec.bounds.low <= value <= spec.bounds.high


def stage_anchor(group: str) -> str:
    """Anchor by which the page finds a group of sliders."""
    return f"stage-{_anchored(group)}"


def setting_anchor(setting: str) -> str:
    """Anchor by which the page finds the slider of a setting such as `refined.residual_px`."""
    return f"setting-{_anchored(setting)}"


def _anchored(name: str) -> str:
    return name.replace("_", "-").replace(".", "-").replace(" ", "-")


def anchor_html(name: str) -> str:
    """HTML of an anchor, highlighted while it is the page's target."""
    return (
        f"<style>#{name}:target{{height:3px;margin:0 12px;background:rgb{theme.BRAND_RGB};scroll-margin:60px}}</style>"
        f"<div id='{name}'></div>"
    )


def stage_counts_html(text: str) -> str:
    """One line with a stage's event counts and time."""
    return f"<div style='font-size:12px;color:{theme.MUTED};padding:0 12px'>{text}</div>"


FOLLOW, FOLLOWING, WHOLE = "Follow the ball", "Follow the ball: already on", "Follow the ball: zoom in first"
NO_BALL: Final = "Follow the ball: on, none found here"
"""Texts of the button: what it does, or why it is disabled."""


def follow_text(state: ClientState, *, found: bool) -> str:
    """Text of the button that lets the zoomed view follow the ball; `found`: whether the shown window has one."""
    if state.tune.zoom <= 1.0:
        return WHOLE
    if state.tune.centre_px is not None:
        return FOLLOW
    return FOLLOWING if found else NO_BALL


IN_SPACE, FLAT = "3D", "Picture"


class TuneViewPanel:
    """Controls of camera, window and zoom."""

    def __init__(self, gui: viser.GuiApi, send: Callable[[Command], None]) -> None:
        self._found = True  # until the first answer
        self.folder = gui.add_folder("View")
        with self.folder:
            self._camera = Listing(gui, "Camera", lambda name: send(SetCamera(name)))
            self._stage = Choice(
                gui, "Stage", VIEWS[DEFAULT_METHOD], lambda value: send(SetOverlay(value)),
                hint="Shows what each stage keeps; keys 1 to 7",
            )  # fmt: skip
            self._zoom = gui.add_slider("Zoom", *ZOOM_RANGE, 0.5, 1.0, hint="Click into the picture to centre it there")
            self._follow = gui.add_button(FOLLOW, icon=viser.Icon.FOCUS_2)
            self._slot = Choice(
                gui, "Config", SLOTS, lambda value: send(SetSlot(value)),  # type: ignore[arg-type]
                hint="The config that the sliders change",
            )  # fmt: skip
            self._changed = gui.add_html("", visible=False)
            self._changes = gui.add_button_group(
                "Changed", ("Show", "Reset all"), visible=False, hint="Show the next changed config; reset all methods"
            )
            self._compare = gui.add_checkbox("Compare A and B", False, hint="Both configs on the same window")
            self._frames = Listing(
                gui, "Frames", lambda name: send(ShowFramesBeside("" if name == NO_FRAMES else name)),
                hint="An ordinary camera's picture nearest to the cursor, beside the events",
            )  # fmt: skip
        # Last of all: above the sliders it would push those of the shown stage out of a window of 720 px.
        self.space_folder = gui.add_folder("Space and time", order=1e6)
        with self.space_folder:
            self._space = Choice(
                gui, "Show", (IN_SPACE, FLAT), lambda value: send(ShowEventsInSpace(value == IN_SPACE)),
                hint="3D: the events of the window and its neighbours in space and time",
            )  # fmt: skip
            self._colour = Choice(
                gui, "Colour", SPACE_COLOURS, lambda value: send(SetSpaceColour(value)),  # type: ignore[arg-type]
                hint="Of the window's events: as in the stage's picture, each candidate, ON and OFF, or green and red "
                "candidates",
            )  # fmt: skip
            self._note = gui.add_html("", visible=False)
        when_changed(self._zoom, lambda value: send(SetZoom(float(str(value)))))
        when_changed(self._compare, lambda value: send(SetCompare(bool(value))))
        when_clicked(self._follow, lambda: send(LookAt(None)))

        @self._changes.on_click
        async def _(event: viser.GuiEvent) -> None:
            if event.client is not None:
                send(ResetAllConfigs() if event.target.value == "Reset all" else ShowChangedConfig())

    def show(self, state: ClientState) -> None:
        """Update the controls from the state."""
        self._camera.offer(state.cameras)
        self._camera.show(state.camera)
        in_space = state.tune.shows_space
        self._space.visible = self._stage.visible = not state.tune.side_by_side
        self._space.show(IN_SPACE if in_space else FLAT)
        self._colour.visible = self._note.visible = in_space
        self._colour.show(state.tune.space_colour)
        self._compare.visible = not state.tune.side_by_side and not in_space
        self._stage.offer(VIEWS[state.tune.method])
        self._stage.show(state.tune.stage)
        self._zoom.value = state.tune.zoom
        self._show_follow(state)
        self._slot.show(state.tune.slot)
        words = changed_words(changed_configs(state))
        self._changed.visible = self._changes.visible = bool(words)
        self._changed.content = stage_counts_html(html_text(words))
        self._compare.value = state.tune.compare
        self._frames.visible = bool(state.titled_frames) and self._compare.visible
        # A camera may be called so, too, and the page takes no option twice.
        self._frames.offer(tuple(dict.fromkeys((NO_FRAMES, *state.titled_frames))))
        self._frames.show(state.tune.frames or NO_FRAMES)

    def show_found(self, state: ClientState, *, found: bool) -> None:
        """Whether the shown window has a ball to follow."""
        self._found = found
        self._show_follow(state)

    def _show_follow(self, state: ClientState) -> None:
        self._follow.label = follow_text(state, found=self._found)
        self._follow.disabled = self._follow.label != FOLLOW

    def show_note(self, text: str) -> None:
        """Say which events are shown in space and time."""
        self._note.content = stage_counts_html(text)


class ConfigFilesPanel:
    """Save and load configs by name: the server makes the path, and offers only files that it finds."""

    def __init__(self, gui: viser.GuiApi, save: Callable[[str], None], load: Callable[[str], None]) -> None:
        self.folder = gui.add_folder("Config file")
        with self.folder:
            form = gui.add_form(None)  # Enter in its text means Save
            with form:
                self._name = gui.add_text("Name", "", hint="Enter saves, too; existing configs are not overwritten")
                when_clicked(gui.add_button("Save", icon=viser.Icon.DEVICE_FLOPPY), form.submit)
            self._saved = Listing(gui, "Saved", lambda name: None, hint="Configs in the workspace")
            when_clicked(gui.add_button("Load", icon=viser.Icon.FOLDER_OPEN), self._load)
        self._load_name = load

        @form.on_submit
        async def _(_: viser.GuiEvent) -> None:
            save(self._name.value)

    def show(self, names: tuple[str, ...], *, chosen: str | None = None) -> None:
        """Offer these configs, and choose one that was just saved."""
        self._saved.offer(names)
        if chosen is not None:
            self._saved.show(chosen)

    def _load(self) -> None:
        if self._saved.chosen is not None:
            self._load_name(self._saved.chosen)


def detect_command(method: str, config: Path) -> str:
    """What to type into a terminal to use a saved config on a recording."""
    return f"rallyscope detect RECORDING --method {method} --config {config} --out ball.csv"
