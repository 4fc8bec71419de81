"""What all packages share: errors, files, lazy faces, compiled code on disk, the start of a command."""
