"""Training and evaluation on labelled cases."""
