"""The file lock of `tracker.io.file_lock`, for the runs that are shared among workers."""

from tracker.io.file_lock import Locked, file_lock, folder_lock, holder_file, output_file_lock

__all__ = ["Locked", "file_lock", "folder_lock", "holder_file", "output_file_lock"]
