"""What the commands do once their arguments are parsed; `arguments` alone imports neither JAX nor MuJoCo."""
