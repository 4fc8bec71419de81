"""How large an encoded tree may be."""

__all__ = ["MAX_NODES"]

MAX_NODES = 250  # sizes are uint8, and a jump table needs three more values
