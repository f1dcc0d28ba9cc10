"""What may befall a folder of --cache between two runs."""
import contextlib
import os


def damage_cache(one, cache):
    """`cache`: the folder."""
    files = [path for path in cache.rglob("*") if path.is_file() and not path.is_symlink()] if cache.exists() else []
    for _ in range(int(one.random.integers(0, 4))):
        if not files:
            break
        path = files[int(one.random.integers(len(files)))]
        if path.is_symlink() or not path.is_file():
            continue
        how = one.pick("flip", "cut", "grow", "swap", "remove", "link", "folder", "fifo", "rights", "empty", "owner", "dangling", "socket")
        with contextlib.suppress(OSError):
            data = bytearray(path.read_bytes())
            if how == "flip" and data:
                data[int(one.random.integers(len(data)))] ^= 1 << int(one.random.integers(8))
                path.write_bytes(data)
            elif how == "cut":
                path.write_bytes(data[:len(data) // 2])
            elif how == "grow":
                path.write_bytes(bytes(data) + bytes(int(one.pick(1, 200_000))))
            elif how == "swap":
                files[int(one.random.integers(len(files)))].replace(path)
            elif how == "rights":
                path.chmod(one.pick(0, 0o444, 0o666))
            elif how == "owner":
                os.chown(path, 65534, 65534)
            elif how == "empty":
                path.write_bytes(b"")
            else:
                path.unlink()
                if how == "link":
                    path.symlink_to(one.folder.parent / "outside")
                elif how == "dangling":
                    path.symlink_to(one.folder / "nowhere")
                elif how == "folder":
                    path.mkdir()
                elif how == "fifo":
                    os.mkfifo(path)
