from __future__ import annotations

from pathlib import Path

import pytest

from core.errors import LabelError
from labels.database.file_system import is_shared, mount_of, refuse_whole_files

MOUNTS = r"""/dev/sda1 / ext4 rw,relatime 0 0
tmpfs /tmp tmpfs rw 0 0
server:/home /mnt/team nfs4 rw 0 0
//nas/share /mnt/my\040labels cifs rw 0 0
anna@host:/ /mnt/team/far fuse.sshfs rw 0 0
/dev/sdb1 /mnt/team/far/disk xfs rw 0 0
share /mnt/host 9p rw 0 0
nonsense
"""


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/home/anna/labels", "ext4"),
        ("/tmp/x", "tmpfs"),
        ("/mnt/team/labels/a.sqlite", "nfs4"),
        ("/mnt/teammate", "ext4"),
        ("/mnt/my labels/a", "cifs"),
        ("/mnt/team/far/x", "fuse.sshfs"),
        ("/mnt/team/far/disk/x", "xfs"),
    ],
)
def test_the_file_system_is_that_of_the_nearest_mount_above(path: str, kind: str) -> None:
    mount = mount_of(Path(path), MOUNTS)
    assert mount is not None and mount.kind == kind


@pytest.mark.parametrize("path", ["/mnt/team/a", "/mnt/my labels/a", "/mnt/team/far/a", "/mnt/host/a"])
def test_a_network_folder_is_one_that_other_machines_write(path: str) -> None:
    assert is_shared(Path(path), MOUNTS)
    refuse_whole_files(Path(path), MOUNTS)


def test_disks_of_this_machine_and_systems_without_a_table_are_not(tmp_path: Path) -> None:
    assert not is_shared(Path("/mnt/team/far/disk/x"), MOUNTS)
    assert not is_shared(tmp_path, "")


def test_a_drive_that_sends_whole_files_is_refused_with_one_line_that_says_what_to_do() -> None:
    bucket = "bucket /mnt/bucket fuse.rclone rw 0 0"
    assert is_shared(Path("/mnt/bucket/x"), bucket)
    with pytest.raises(LabelError, match=r"sends whole files.*rclone.*--data") as error:
        refuse_whole_files(Path("/mnt/bucket/x"), bucket)
    assert "\n" not in str(error.value) and "/mnt/bucket/x" in str(error.value)


def test_any_folder_can_be_called_shared(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RALLYSCOPE_LABEL_JOURNAL", "rollback")
    assert is_shared(tmp_path, "")
    monkeypatch.setenv("RALLYSCOPE_LABEL_JOURNAL", "none")
    with pytest.raises(LabelError, match=r"expected rollback.*none"):
        is_shared(tmp_path, "")


WSL = r"""/dev/sdc / ext4 rw,relatime 0 0
C:\134 /mnt/c 9p rw,noatime,dirsync,aname=drvfs;path=C:\;uid=1000;gid=1000,mmap,access=client,trans=fd 0 0
D: /mnt/d drvfs rw,noatime,uid=1000,gid=1000,case=off 0 0
drvfs /mnt/e virtiofs rw,relatime 0 0
share /mnt/share virtiofs rw,relatime 0 0
"""


@pytest.mark.parametrize("path", ["/mnt/c/Users/anna/labels", "/mnt/d/x", "/mnt/e/x"])
def test_programs_of_windows_write_to_a_disk_of_windows_too(path: str) -> None:
    assert is_shared(Path(path), WSL)
    refuse_whole_files(Path(path), WSL)


def test_other_folders_of_such_a_linux_are_its_own() -> None:
    for path in ("/home/anna/labels", "/mnt/share/labels"):
        assert not is_shared(Path(path), WSL)
