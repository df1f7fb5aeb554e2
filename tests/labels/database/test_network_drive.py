from __future__ import annotations

from pathlib import Path

import pytest

from core.errors import LabelError
from labels.database.connection import mount_of, refuse_network_drive

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
def test_a_network_drive_is_refused_with_one_line_that_says_what_to_do(path: str) -> None:
    with pytest.raises(LabelError, match=r"cannot be kept on a network drive.*--data") as error:
        refuse_network_drive(Path(path), MOUNTS)
    assert "\n" not in str(error.value) and path in str(error.value)


def test_disks_of_this_machine_and_systems_without_a_table_are_taken(tmp_path: Path) -> None:
    refuse_network_drive(Path("/mnt/team/far/disk/x"), MOUNTS)
    refuse_network_drive(tmp_path, "")


WSL = r"""/dev/sdc / ext4 rw,relatime 0 0
C:\134 /mnt/c 9p rw,noatime,dirsync,aname=drvfs;path=C:\;uid=1000;gid=1000,mmap,access=client,trans=fd 0 0
D: /mnt/d drvfs rw,noatime,uid=1000,gid=1000,case=off 0 0
drvfs /mnt/e virtiofs rw,relatime 0 0
share /mnt/share virtiofs rw,relatime 0 0
"""


@pytest.mark.parametrize("path", ["/mnt/c/Users/anna/labels", "/mnt/d/x", "/mnt/e/x"])
def test_a_disk_of_windows_is_called_what_it_is_and_the_line_names_the_linux_home(path: str) -> None:
    with pytest.raises(LabelError, match=r"a disk of Windows.*--data a folder in your Linux home") as error:
        refuse_network_drive(Path(path), WSL)
    assert "\n" not in str(error.value) and path in str(error.value) and "network" not in str(error.value)


def test_other_folders_of_such_a_linux_are_taken() -> None:
    for path in ("/home/anna/labels", "/mnt/share/labels"):
        refuse_network_drive(Path(path), WSL)
