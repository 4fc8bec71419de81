"""Parts of the page that several panels show: the scene, trees, curves, clusters."""
